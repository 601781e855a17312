"""The energy ledger: its balance, and its parts against other means."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, optimize

from hapticd.plant.exact import propagate
from hapticd.stability.ledger import LIMIT, Ledger, ledger
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.storage import potential, rho

from .motion import simulate

DELAYS = st.sampled_from([0.0, 0.074, 0.5, 1.0, 1.25, 2.0, 3.6])
OPERATING_POINTS = st.builds(
    Dimensionless,
    mu=st.floats(1.0, 1e4),
    beta=st.floats(0.0, 1.5),
    sigma=st.floats(0.0, 3.0),
    tau_d=DELAYS,
    kappa=st.sampled_from([0.0, 0.0, 0.4]),
)
PAPERS_POINT = Dimensionless(100.0, 0.3, 0.7, 0.6)


@settings(max_examples=300, deadline=None)
@given(OPERATING_POINTS, st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-3.0, 3.0))
def test_the_balance_closes(numbers: Dimensionless, xi: float, xi_dot: float, hand: float) -> None:
    account = ledger(numbers, xi, xi_dot, 40, hand)
    assert np.all(np.abs(account.residual) <= 1e-12 * np.maximum(account.scale, 1.0))
    assert np.all(account.viscous >= 0.0)
    assert np.all(account.coulomb >= 0.0)


@settings(max_examples=60, deadline=None)
@given(st.floats(1.0, 1e3), st.floats(0.0, 1.0), st.floats(0.0, 1.5), DELAYS, st.floats(-8.0, 8.0))
def test_the_motion_is_the_simulated_one(mu: float, beta: float, sigma: float, tau_d: float, xi_dot: float) -> None:
    numbers = Dimensionless(mu, beta, sigma, tau_d)
    account = ledger(numbers, 0.2, xi_dot, 30)
    motion = simulate(numbers, 0.2, xi_dot, 30)
    states = np.column_stack((account.xi, account.xi_dot))
    if tau_d == 0.0:
        expected, found = np.array(motion.samples), states
    else:
        # the coast of whole periods has switches of its own there, in which no force changes
        expected, found = np.array(motion.switches)[int(tau_d) :], states[1:]
    count = min(len(expected), len(found))
    assert count >= 1
    assert found[:count] == pytest.approx(expected[:count], rel=1e-11, abs=1e-11)


def test_generated_energy_is_force_less_that_of_the_quantised_spring_times_way() -> None:
    account = ledger(PAPERS_POINT, 0.35, 2.5, 60)
    direct = account.force * np.diff(account.xi) + np.diff(potential(account.xi))  # (29) with (31)
    assert account.generated == pytest.approx(direct, rel=1e-12, abs=1e-12)


def _crossings(n: Dimensionless, xi: float, xi_dot: float, force: float) -> list[float]:
    """When the encoder's reading changes within a period of constant force and less than 2000 ticks."""

    def place(t: float) -> float:
        return propagate(xi, xi_dot, t, force, n.mu, n.beta, n.sigma)[0]

    times = np.linspace(0.0, 1.0, 2001)
    readings = np.floor([place(t) for t in times])
    changes = np.flatnonzero(np.diff(readings))
    edges = np.maximum(readings[changes], readings[changes + 1])
    return [
        float(optimize.brentq(lambda t, edge=edge: place(t) - edge, times[k], times[k + 1], xtol=1e-15))
        for k, edge in zip(changes, edges, strict=True)
    ]


def test_generated_and_dissipated_energy_against_quadrature() -> None:
    n = PAPERS_POINT
    account = ledger(n, 0.35, 2.5, 12)
    for k in (1, 4, 9):
        start, v, force = account.xi[k], account.xi_dot[k], account.force[k]
        crossings = _crossings(n, start, v, force)

        def state(t: float, start: float = start, v: float = v, force: float = force) -> tuple[float, float]:
            return propagate(start, v, t, force, n.mu, n.beta, n.sigma)

        def power(t: float, force: float = force) -> float:
            x, speed = state(t)
            return float((force + np.floor(x) + 0.5) * speed)

        assert len(crossings) == abs(np.floor(account.xi[k + 1]) - np.floor(start))  # no turn within these periods
        edges = [0.0, *crossings, 1.0]
        inside = [(a + 1e-13, b - 1e-13) for a, b in itertools.pairwise(edges)]
        generated = sum(integrate.quad(power, a, b)[0] for a, b in inside)
        viscous = n.beta * integrate.quad(lambda t: state(t)[1] ** 2, 0.0, 1.0)[0]
        coulomb = n.sigma * integrate.quad(lambda t: abs(state(t)[1]), 0.0, 1.0)[0]
        assert account.generated[k] == pytest.approx(generated, rel=1e-9, abs=1e-10)
        assert account.viscous[k] == pytest.approx(viscous, rel=1e-9)
        assert account.coulomb[k] == pytest.approx(coulomb, rel=1e-9)


def test_the_printed_signs_of_eq_54_do_not_balance() -> None:
    account = ledger(PAPERS_POINT, 0.35, 2.5, 40)
    a, b, h = rho(account.xi[1:-1]), rho(account.xi[2:]), rho(account.sampled[1:])
    ticks, start, way = np.diff(np.floor(account.xi))[1:], account.xi[1:-1], np.diff(account.xi)[1:]
    sampling = 0.5 * way * way + (start - account.sampled[1:]) * way  # (53)
    printed = (h - 0.5) * ticks + 0.5 * (b - a) ** 2 + (a - h) * (b - a)
    corrected = (h - 0.5) * ticks - 0.5 * (b - a) ** 2 - (a - h) * (b - a)
    assert account.generated[1:] == pytest.approx(sampling + corrected, abs=1e-12)
    assert np.max(np.abs(account.generated[1:] - sampling - printed)) > 0.5


def test_the_counterexample_to_eq_12_gains_energy_in_region_a() -> None:
    account = ledger(Dimensionless(100.0, 0.51, 0.51), 0.99, 0.5, 1)
    assert account.stored == pytest.approx([12.995, 13.103], abs=5e-4)
    assert account.generated[0] > account.dissipated[0]


def test_before_the_first_force_the_spring_is_filled_for_nothing() -> None:
    account = ledger(Dimensionless(100.0, 0.0, 0.0, 1.5), 0.0, 2.0, 4)
    assert account.coasts
    assert account.tau[:3] == pytest.approx([0.0, 1.5, 2.5])
    assert account.generated[0] == pytest.approx(float(potential(3.0)))
    assert account.force[0] == 0.0


def test_a_hand_pays_for_what_it_adds() -> None:
    push = np.linspace(-4.0, 9.0, 30)
    account = ledger(Dimensionless(20.0, 0.2, 0.4), 0.0, 0.0, 30, push)
    assert account.hand == pytest.approx(push * np.diff(account.xi))
    gained = account.stored[-1] - account.stored[0]
    assert gained == pytest.approx((account.hand + account.generated - account.dissipated).sum(), rel=1e-12)


def test_a_motion_that_grows_ends_at_the_limit() -> None:
    account: Ledger = ledger(Dimensionless(5.0, 0.0, 0.0), 0.0, 5.0, 100_000)
    assert np.abs(account.xi[-1]) > LIMIT
    assert account.xi.size < 1000
    assert np.all(np.abs(account.residual) <= 1e-12 * account.scale)


@pytest.mark.parametrize(
    ("numbers", "periods", "hand", "words"),
    [
        (Dimensionless(np.inf, 1.0, 1.0), 5, 0.0, "there is no spring"),
        (Dimensionless(1.0, 1.0, 1.0, 2.5), 3, 0.0, "no interval of force"),
        (Dimensionless(1.0, 1.0, 1.0, 0.5), 3, [1.0, 2.0, 3.0], "must be constant"),
    ],
)
def test_what_cannot_be_accounted_for_is_refused(
    numbers: Dimensionless, periods: int, hand: float | list[float], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        ledger(numbers, 0.0, 1.0, periods, hand)
