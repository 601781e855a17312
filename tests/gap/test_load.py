"""The load behind a play, as the filter knows it: against matrices written out."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.gap.kernel.load import carry, see, spread_along, tie

Floats = NDArray[np.float64]
PERIOD, DECAY = 1e-3, 0.9


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def _covariance(rng: np.random.Generator) -> Floats:
    """Of x, v, d and the load's position and velocity, shape (5, 5)."""
    root = rng.normal(size=(5, 5))
    return root @ root.T


def _parts(whole: Floats) -> tuple[Floats, Floats]:
    return np.ascontiguousarray(whole[3:, :3]), np.ascontiguousarray(whole[3:, 3:])


def test_a_count_tells_of_the_load_as_in_a_kalman_filter(rng: np.random.Generator) -> None:
    whole, seen, share = _covariance(rng), 1.1, 0.8
    row = seen * np.eye(5)[0]
    variance = float(row @ whole @ row) + 0.3
    gain = whole @ row / variance
    C, P = _parts(whole)
    assert see(C, P, seen, variance, share, *gain[:3]) == pytest.approx(tuple(gain[3:]))
    expected = whole - share * variance * np.outer(gain, gain)
    np.testing.assert_allclose(C, expected[3:, :3])
    np.testing.assert_allclose(P, expected[3:, 3:])


@pytest.mark.parametrize(("J", "K"), [(0.0, 0.0), (0.4, 0.6), (0.56, 0.84)])
def test_what_w_does_not_tell_is_carried_linearly(rng: np.random.Generator, J: float, K: float) -> None:
    whole, half = _covariance(rng), 0.5 * PERIOD
    w = np.array([0.0, 1.0, 0.2, 0.0, 0.0])
    ww = float(w @ whole @ w)
    along = whole @ w / ww
    across = whole - ww * np.outer(along, along)
    # Across w the shaft keeps half its way and no velocity; the load coasts; then the impact.
    coast = np.array(
        [[1, half, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, DECAY, 0, 0], [0, 0, 0, 1, PERIOD], [0, 0, 0, 0, 1.0]]
    )
    impact = np.eye(5)
    impact[0, [0, 3]] = impact[1, [1, 4]] = 1.0 - J, J
    impact[3, [3, 0]] = impact[4, [4, 1]] = 1.0 - K, K
    free, met = coast @ across @ coast.T, impact @ coast @ across @ coast.T @ impact.T
    C, P = _parts(whole)
    shaft = across[[0, 0, 0, 1, 1], [0, 1, 2, 1, 2]]
    more = carry(C, P, along, shaft, ww, PERIOD, DECAY, half, J, K)
    np.testing.assert_allclose(more, (met - free)[[0, 0, 0, 1, 1], [0, 1, 2, 1, 2]], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(C, met[3:, :3], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(P, met[3:, 3:], rtol=1e-9, atol=1e-12)


def test_an_impact_within_the_period_has_that_effect_whenever_it_happens() -> None:
    """Two masses that meet at an instant of their own: position and velocity at the end are linear in where they began."""
    part, e, edge = 0.4, 0.3, 1e-3

    def end(x: float, v: float, load: float, load_v: float) -> Floats:
        meets = (load + edge - x) / (v - load_v)
        assert 0.0 < meets < PERIOD
        change = (1.0 + e) * (v - load_v)
        v_end, load_end = v - part * change, load_v + (1.0 - part) * change
        rest = PERIOD - meets
        return np.array([x + v * meets + v_end * rest, v_end, load + load_v * meets + load_end * rest, load_end])

    J, K = (1.0 + e) * part, (1.0 + e) * (1.0 - part)
    begun = np.array([0.0, 3.0, 0.0, 1.0])
    moved = np.array([2e-5, -3e-2, -1e-5, 2e-2])
    x, v, load, load_v = moved
    way, load_way = x + PERIOD * v, load + PERIOD * load_v
    expected = [
        (1 - J) * way + J * load_way,
        (1 - J) * v + J * load_v,
        (1 - K) * load_way + K * way,
        (1 - K) * load_v + K * v,
    ]
    assert end(*(begun + moved)) - end(*begun) == pytest.approx(expected, rel=1e-9)


def test_in_contact_the_load_varies_with_the_shaft(rng: np.random.Generator) -> None:
    whole = _covariance(rng)
    C, P = np.empty((2, 3)), np.empty((2, 2))
    tie(C, P, *whole[[0, 0, 0, 1, 1], [0, 1, 2, 1, 2]])
    np.testing.assert_array_equal(C, whole[:2, :3])
    np.testing.assert_array_equal(P, whole[:2, :2])


def test_points_along_w_vary_together(rng: np.random.Generator) -> None:
    weights = np.array([1.0, 4.0, 1.0]) / 6.0
    points = rng.normal(size=(5, 3))
    means = points @ weights
    expected = np.cov(points, aweights=weights, ddof=0)
    C, P = np.zeros((2, 3)), np.zeros((2, 2))
    weights.flags.writeable = False
    spread_along(C, P, weights, *points, *means)
    np.testing.assert_allclose(C, expected[3:, :3], atol=1e-15)
    np.testing.assert_allclose(P, expected[3:, 3:], atol=1e-15)
