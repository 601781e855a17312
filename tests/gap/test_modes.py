"""The modes of the filter: merged, seen, cut, and a load behind a play, against matrices and sampling written out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import truncnorm

from hapticd.gap.kernel import carry, device
from hapticd.gap.kernel.modes import DOWN, HELD, MODE, STATES, STOPPED, UP, W, impact, join, spread, take, tie
from hapticd.plant.layout import index_of, neutral_vector

Floats = NDArray[np.float64]
PERIOD_S, INERTIA, COULOMB = 1e-3, 2e-5, 1e-3
UNIT = PERIOD_S / INERTIA


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def _covariance(rng: np.random.Generator, size: int = STATES) -> Floats:
    root = rng.normal(size=(size, size))
    return np.asarray(root @ root.T)


def test_pieces_join_into_their_mean_and_covariance(rng: np.random.Generator) -> None:
    pieces = np.zeros(3, MODE)
    weights, shifts, taken = np.array([0.2, 0.3, 0.1]), np.array([0.0, -0.4, 0.7]), np.array([0.0, 0.2, 0.3])
    pieces["mean"] = rng.normal(size=(3, STATES))
    pieces["gain"] = 0.3 * rng.normal(size=(3, STATES))
    pieces["covariance"] = [_covariance(rng) for _ in range(3)]
    pieces["contact"] = [-1.0, 0.0, 1.0]
    joined = np.zeros(1, MODE)
    for k in range(3):
        join(joined[0], pieces[k], weights[k], shifts[k], taken[k], STATES)
    assert joined["weight"] == pytest.approx([0.6])
    assert joined["contact"] == [0.0]
    shares = weights / weights.sum()
    means = pieces["mean"] + shifts[:, None] * pieces["gain"]
    spreads = pieces["covariance"] - taken[:, None, None] * np.einsum("ki,kj->kij", pieces["gain"], pieces["gain"])
    mean = shares @ means
    expected = np.einsum("k,kij->ij", shares, spreads) + (means - mean).T @ np.diag(shares) @ (means - mean)
    np.testing.assert_allclose(joined[0]["mean"], mean)
    np.testing.assert_allclose(joined[0]["covariance"], expected)


def test_a_count_tells_of_the_whole_state_as_in_a_kalman_filter(rng: np.random.Generator) -> None:
    mode = np.zeros(1, MODE)
    whole, mean, seen, share, moved = _covariance(rng), rng.normal(size=STATES), 1.1, 0.8, 0.3
    mode[0]["covariance"], mode[0]["mean"] = whole, mean
    row = seen * np.eye(STATES)[0]
    variance = float(row @ whole @ row) + 0.3
    take(mode[0], seen, variance, share, moved, STATES)
    gain = whole @ row / variance
    np.testing.assert_allclose(mode[0]["mean"], mean + gain * moved)
    np.testing.assert_allclose(mode[0]["covariance"], whole - share * variance * np.outer(gain, gain))


def _cut(mode: int, v: float, d: float, spread: Floats, current: float) -> Any:
    """Pieces of a mode with the standard deviations `spread` of x, v, d, by what they will do."""
    p = neutral_vector()
    for name, value in {"inertia": INERTIA, "viscous": 0.0, "coulomb": COULOMB, "torque_constant": 1.0}.items():
        p[index_of(name)] = value
    laws, periods = np.zeros(1, device.LAWS), np.zeros(1, device.PERIOD)
    device.look_up(p, np.zeros((1, 1)), laws[0])
    periods[0]["span"], periods[0]["decay"], periods[0]["mean"] = PERIOD_S, 1.0, 1.0
    modes, pieces = np.zeros(3, MODE), np.zeros(4, MODE)
    modes[mode]["weight"] = 1.0
    modes[mode]["mean"][1:3] = v, d
    modes[mode]["covariance"][:3, :3] = np.diag(np.square(spread))
    span, amperes = np.array([PERIOD_S]), np.array([current])
    carry.cut(p, laws, periods, span, amperes, modes, mode, pieces)
    return pieces


def test_a_held_shaft_is_cut_where_stiction_ends() -> None:
    spread = 0.2 * COULOMB
    pieces = _cut(HELD, 0.0, 0.0, np.array([1e-6, 0.0, spread]), 0.8 * COULOMB)
    np.testing.assert_array_equal(np.flatnonzero(pieces["weight"]), [HELD, UP])
    pieces = pieces[[HELD, UP]]
    edge = 0.2 * COULOMB / spread
    held, loose = truncnorm(-1.8 * COULOMB / spread, edge), truncnorm(edge, math.inf)
    assert pieces["weight"].sum() == pytest.approx(1.0, abs=1e-6)
    assert pieces["weight"][1] == pytest.approx(0.5 * math.erfc(edge / math.sqrt(2.0)), rel=1e-6)
    assert pieces["mean"][:, 2] == pytest.approx([spread * held.mean(), spread * loose.mean()], rel=1e-3)
    assert pieces["covariance"][:, 2, 2] == pytest.approx(spread**2 * np.array([held.var(), loose.var()]), rel=1e-3)
    assert pieces["mean"][:, W] == pytest.approx(UNIT * pieces["mean"][:, 2])


def test_a_moving_shaft_goes_on_stops_or_turns() -> None:
    pieces = _cut(UP, 0.0, 0.0, np.array([1e-6, UNIT * COULOMB, 0.0]), 0.0)
    assert pieces["weight"][[STOPPED, UP, DOWN]] == pytest.approx([0.6827, 0.1587, 0.1587], abs=1e-4)
    assert pieces["weight"][HELD] == 0.0
    pieces = _cut(UP, 20.0 * UNIT * COULOMB, 0.0, np.array([1e-6, UNIT * COULOMB, 0.0]), 0.0)
    assert pieces["weight"].tolist() == [0.0, 1.0, 0.0, 0.0]


def test_an_impact_within_the_period_has_one_effect_whenever_it_happens() -> None:
    """Two masses that meet at an instant of their own: position and velocity at the end are linear in where they began."""
    part, e, edge = 0.4, 0.3, 1e-3

    def end(x: float, v: float, load: float, load_v: float) -> Floats:
        meets = (load + edge - x) / (v - load_v)
        assert 0.0 < meets < PERIOD_S
        change = (1.0 + e) * (v - load_v)
        v_end, load_end = v - part * change, load_v + (1.0 - part) * change
        rest = PERIOD_S - meets
        return np.array([x + v * meets + v_end * rest, v_end, load + load_v * meets + load_end * rest, load_end])

    begun, moved = np.array([0.0, 3.0, 0.0, 1.0]), np.array([2e-5, -3e-2, -1e-5, 2e-2])
    difference = end(*(begun + moved)) - end(*begun)
    x, v, load, load_v = moved
    coasted = np.array([x + PERIOD_S * v, v, 0.0, 0.0, load + PERIOD_S * load_v, load_v])
    piece = np.zeros(1, MODE)
    piece[0]["covariance"] = np.outer(coasted, coasted)
    impact(piece[0], (-e, 0.0, 0.0, -e), part)
    expected = np.array([difference[0], difference[1], 0.0, 0.0, difference[2], difference[3]])
    np.testing.assert_allclose(piece[0]["covariance"], np.outer(expected, expected), rtol=1e-9, atol=1e-15)


def test_what_varies_is_carried_linearly(rng: np.random.Generator) -> None:
    piece, half, slide = np.zeros(1, MODE), 0.5 * PERIOD_S, 0.9
    whole = _covariance(rng)
    piece[0]["covariance"] = whole
    spread(piece[0], half, slide, STATES)
    A = np.eye(STATES)
    A[0, [1, W]], A[1] = (half, half * slide), slide * np.eye(STATES)[W]
    A[4, 5] = PERIOD_S
    np.testing.assert_allclose(piece[0]["covariance"], A @ whole @ A.T, rtol=1e-12)


def test_in_contact_the_load_varies_with_the_shaft(rng: np.random.Generator) -> None:
    piece = np.zeros(1, MODE)
    whole = _covariance(rng)
    piece[0]["covariance"] = whole
    tie(piece[0])
    order = [0, 1, 2, 3, 0, 1]
    np.testing.assert_array_equal(piece[0]["covariance"], whole[np.ix_(order, order)])
