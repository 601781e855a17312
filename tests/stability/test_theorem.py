from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from hapticd.stability.criterion import Criterion, criterion_margin, dissipation_margin
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.regions import region
from hapticd.stability.storage import velocity_bound
from tests.stability.theorem import check, draw, least_sigma
from tests.stability.theorem_kernel import (
    FIRST_RISE,
    LARGEST_RISE,
    PERIODS,
    RISES,
    TOP_ACCELERATION,
    TOP_SPEED,
    check_all,
    work_space,
)

from .motion import simulate


@pytest.mark.parametrize("criterion", ["corrected", "sharp"])
def test_energy_never_rises_where_it_is_proven(criterion: Criterion) -> None:
    verdict = check(criterion, 3000, seed=1, periods=1000, fate_periods=20_000)
    assert (verdict.drawn, verdict.bounds_broken, verdict.counted) == (3000, 0, 3000)
    assert (verdict.rising, verdict.rises, verdict.smallest) == (0, 0, None)
    assert verdict.largest_change < 1e-12
    assert verdict.persistent == verdict.growing == 0
    assert verdict.at_rest + verdict.falling == 3000


def test_energy_rises_under_the_papers_criterion_and_every_motion_still_dies_out() -> None:
    verdict = check("paper", 3000, seed=1, periods=1000, fate_periods=50_000)
    assert 0.2 < verdict.share_rising < 0.6
    assert verdict.persistent == verdict.growing == 0
    found = verdict.smallest
    assert found is not None
    # it is inside the paper's region, and the slow reference simulation finds the same rise
    numbers = Dimensionless(found.mu, found.beta, found.sigma, found.tau_d)
    bound = float(velocity_bound(found.xi, found.xi_dot, found.mu, found.tau_d))
    assert region(numbers, bound) in ("A", "E", "F1")
    energy = simulate(numbers, found.xi, found.xi_dot, found.period + 2).energy("switches")
    rise = np.diff(energy)[math.floor(found.tau_d) :] / energy[math.floor(found.tau_d) : -1]
    assert rise.max() > 1e-9


def test_the_threads_do_not_change_the_verdict() -> None:
    one, two = (check("paper", 2000, seed=7, periods=100, fate_periods=100, jobs=jobs) for jobs in (1, 2))
    assert one == two


@pytest.mark.parametrize("criterion", ["paper", "corrected", "sharp"])
def test_draws_are_where_the_criterion_holds_and_half_of_them_on_its_edge(criterion: Criterion) -> None:
    d = draw(criterion, 1000, np.random.default_rng(5))
    assert (dissipation_margin(d.mu, d.beta, d.sigma, d.tau_d, d.xi_dot_max, criterion) >= 0.0).all()
    just_below = dissipation_margin(d.mu, d.beta, d.sigma * (1.0 - 1e-9), d.tau_d, d.xi_dot_max, criterion) < 0.0
    assert 0.4 < just_below.mean() < 0.6
    least = least_sigma(criterion, d.mu, d.beta, d.tau_d, d.xi_dot_max)
    assert (d.sigma >= least).all()
    assert (d.sigma <= 1.3 * least).all()


def test_the_check_sees_what_the_reference_simulation_sees() -> None:
    d = draw("paper", 60, np.random.default_rng(11))
    counts, extremes, peaks = work_space(60)
    check_all(d.mu, d.beta, d.sigma, d.tau_d, d.xi, d.xi_dot, 400, 12, counts, extremes, peaks)
    for k in range(60):
        numbers = Dimensionless(float(d.mu[k]), float(d.beta[k]), float(d.sigma[k]), float(d.tau_d[k]))
        run = simulate(numbers, float(d.xi[k]), float(d.xi_dot[k]), int(counts[k, PERIODS]))
        whole = math.floor(numbers.tau_d)
        energy = run.energy("switches")[whole:]
        rising = np.flatnonzero(energy[1:] > energy[:-1] * (1.0 + 1e-9))
        assert counts[k, RISES] >= rising.size
        if rising.size and numbers.tau_d == whole:
            assert counts[k, FIRST_RISE] == rising[0] + whole + 1
            assert extremes[k, LARGEST_RISE] == pytest.approx(float((energy[1:] / energy[:-1]).max() - 1.0), rel=1e-6)
        assert extremes[k, TOP_SPEED] == run.top_speed
        assert extremes[k, TOP_ACCELERATION] == pytest.approx(run.top_acceleration, rel=1e-12)


def test_a_motion_past_its_bounds_is_not_counted() -> None:
    # far below the critical line the motion grows past ξ̇_max; the check must notice
    numbers = Dimensionless(100.0, 0.05, 0.6)
    counts, extremes, peaks = work_space(1)
    one = [np.array([value]) for value in (numbers.mu, numbers.beta, numbers.sigma, 0.0, 0.0, 50.0)]
    check_all(*one, 2000, 12, counts, extremes, peaks)
    assert counts[0, RISES] > 0
    assert extremes[0, TOP_SPEED] > 2.0 * float(velocity_bound(0.0, 50.0, numbers.mu))


def _one_period(xi: mpmath.mpf, xi_dot: mpmath.mpf, force: float) -> tuple[mpmath.mpf, mpmath.mpf]:
    """A period at μ = 100, β = σ = 0.51 in 30 digits, for a mass that does not turn."""
    mu, beta = mpmath.mpf(100), mpmath.mpf("0.51")
    terminal = (force - mpmath.sign(xi_dot) * mpmath.mpf("0.51")) / beta
    decay = mpmath.exp(-beta / mu)
    position = xi + terminal + (xi_dot - terminal) * (1 - decay) * mu / beta
    return position, terminal + (xi_dot - terminal) * decay


def _energy(xi: mpmath.mpf, xi_dot: mpmath.mpf) -> mpmath.mpf:
    rho = xi - mpmath.floor(xi)
    return 50 * xi_dot**2 + xi**2 / 2 + (rho - rho**2) / 2


COUNTEREXAMPLES = {
    # ξ(0), ξ̇(0), energies at the samples; the force is −½ in each of these periods
    "the first period": ("0", "-0.5", [12.5, 12.617525]),
    "its mirror image": ("0.99", "0.5", [12.995, 13.102599]),
    "the third period": ("0", "0.51", [13.005, 12.618753, 12.245361, 12.357732]),
}


@pytest.mark.parametrize(("xi", "xi_dot", "energies"), COUNTEREXAMPLES.values(), ids=COUNTEREXAMPLES)
def test_the_counterexamples_of_the_page_in_thirty_digits(xi: str, xi_dot: str, energies: list[float]) -> None:
    numbers = Dimensionless(100.0, 0.51, 0.51)
    bound = float(velocity_bound(float(xi), float(xi_dot), 100.0))
    assert region(numbers, bound) == "A"
    assert criterion_margin(numbers, bound) > 0.0
    with mpmath.workdps(30):
        state = [(mpmath.mpf(xi), mpmath.mpf(xi_dot))]
        for _ in energies[1:]:
            state.append(_one_period(*state[-1], -0.5))
        exact = [float(_energy(*point)) for point in state]
    assert exact == pytest.approx(energies, abs=1e-6)
    assert exact[-1] > exact[-2]
    run = simulate(numbers, float(xi), float(xi_dot), len(energies) - 1)
    np.testing.assert_allclose(run.samples, np.array(state, dtype=np.float64), rtol=0.0, atol=1e-13)
    assert simulate(numbers, float(xi), float(xi_dot), 5000).at_rest


def test_the_first_period_by_hand() -> None:
    """The inequalities of docs/explanation/counterexample.md, which need no exponential."""
    slowest = 0.5 - (0.01 + 0.51 * 0.5) / 100
    way = 0.5 - (0.01 + 0.51 * 0.5) / 200
    assert slowest == pytest.approx(0.49735)
    assert way > 0.49867
    rise = way - (0.51 * 0.5 + 0.51) * way
    assert rise > 0.1171
    run = simulate(Dimensionless(100.0, 0.51, 0.51), 0.0, -0.5, 1)
    assert way <= -run.samples[1][0] <= 0.5
    assert -run.samples[1][1] >= slowest
    assert np.diff(run.energy())[0] >= rise


def test_the_first_period_rises_from_anywhere_near_the_edge() -> None:
    for xi in np.linspace(0.0, 0.11, 12):
        energy = simulate(Dimensionless(100.0, 0.51, 0.51), float(xi), -0.5, 1).energy()
        assert energy[1] > energy[0]


def test_the_third_period_by_hand() -> None:
    slowest, fastest = (0.5 + 0.51) / 100, (0.5 + 0.51 + 0.51 * 0.51) / 100  # decelerations in tick 0
    xi_low, xi_high = 2 * 0.51 - 2 * fastest, 2 * 0.51 - 2 * slowest
    v_low, v_high = 0.51 - 2 * fastest, 0.51 - 2 * slowest
    assert (xi_low, xi_high, v_low, v_high) == pytest.approx((0.9946, 0.9998, 0.4846, 0.4898), abs=5e-6)
    way = v_low - fastest / 2
    rise = way - (1.0 - xi_low) - (0.51 * v_high + 0.51) * way
    assert rise > 0.109
    energy = simulate(Dimensionless(100.0, 0.51, 0.51), 0.0, 0.51, 3).energy()
    assert energy[3] - energy[2] >= rise
