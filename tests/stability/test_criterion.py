from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.stability.criterion import (
    Criterion,
    criterion_margin,
    dissipation_margin,
    mahvash_hayward_margin,
    rest_margin,
    sampling_bound_ok,
    sampling_ratio,
    velocity_limit,
    velocity_margin,
    xi_ddot_bound,
)
from hapticd.stability.numbers import Dimensionless, Loop
from hapticd.stability.sharp import mean_error, sharp_requirement
from hapticd.stability.storage import velocity_bound

from .motion import simulate

CRITERIA: tuple[Criterion, ...] = ("paper", "corrected", "sharp")
betas, sigmas, speeds = st.floats(0.0, 3.0), st.floats(0.0, 5.0), st.floats(1e-3, 300.0)


def test_sampling_bound() -> None:
    # ω_s = 2ω_n exactly at μ = 1/π² (eq. 10, 11)
    assert sampling_ratio(Dimensionless(1.0 / math.pi**2, 0.5, 0.5)) == pytest.approx(1.0)
    assert sampling_ratio(Dimensionless(2.0 / math.pi**2, 0.5, 0.5, kappa=1.0)) == pytest.approx(1.0)
    assert not sampling_bound_ok(Dimensionless(0.2, 0.5, 0.5))
    assert sampling_bound_ok(Dimensionless(5.0, 0.5, 0.5))


@given(betas, sigmas, speeds)
def test_eq_12_is_the_margin_over_the_velocity(beta: float, sigma: float, v: float) -> None:
    printed = (beta - 0.5) + (sigma - 0.5) / v
    assert float(velocity_margin(beta, sigma, v)) == pytest.approx(v * printed, abs=1e-9)
    both = float(dissipation_margin(100.0, beta, sigma, 0.0, v))
    assert both == pytest.approx(min(v * printed, sigma - 0.5), abs=1e-9)


@given(betas, sigmas, speeds, st.floats(0.0, 3.0), st.floats(0.0, 10.0))
def test_eq_19_is_eq_59_at_its_worst(beta: float, sigma: float, v: float, tau_d: float, a: float) -> None:
    # (59) with (60) at every speed up to v; linear in the speed, so its smallest value is at one of the ends
    speed = np.linspace(0.0, v, 17)
    eq_59 = speed * (beta - 0.5 - tau_d) + sigma - 0.5 - tau_d * a * (1.0 + tau_d)
    ours = float(dissipation_margin(100.0, beta, sigma, tau_d, v, xi_ddot_max=a))
    assert ours == pytest.approx(eq_59.min(), abs=1e-9)


def test_eq_16_in_si_units() -> None:
    # (b − KT/2) + c/ẋ_max, over KΔ and times ẋ_max, is the unquantised margin
    loop = Loop(0.1, 0.3, 0.2, 900.0, 3e-5, 1e-3)
    n, v_si = loop.numbers, 0.4
    printed = (loop.viscous - 900.0 * 1e-3 / 2.0) + loop.coulomb / v_si
    ours = float(velocity_margin(n.beta, n.sigma, loop.scales.velocity_to_xi_dot(v_si), quantum=0.0))
    assert loop.scales.phi_to_force(ours) == pytest.approx(printed * v_si)


def test_eq_15_in_si_units() -> None:
    loop = Loop(0.22, 0.01, 0.147, 14500.0, 10e-6, 1e-3 / 3.0)  # Omega
    printed = (2 * 0.147 - 14500.0 * 10e-6) / (14500.0 * 1e-3 / 3.0 - 2 * 0.01)
    assert loop.scales.xi_dot_to_velocity(velocity_limit(loop.numbers)) == pytest.approx(printed)


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("tau_d", [0.0, 0.3, 1.25])
def test_velocity_limit_is_where_the_margin_changes_sign(criterion: Criterion, tau_d: float) -> None:
    n = Dimensionless(400.0, 0.2, 3.0, tau_d)
    limit = velocity_limit(n, criterion)
    assert criterion_margin(n, limit * (1 - 1e-9), criterion) >= 0.0
    assert criterion_margin(n, limit * (1 + 1e-9), criterion) < 0.0


def test_velocity_limit_extremes() -> None:
    assert velocity_limit(Dimensionless(100.0, 0.5, 0.5)) == math.inf
    assert velocity_limit(Dimensionless(100.0, 0.7, 1.0), "sharp") == math.inf
    assert velocity_limit(Dimensionless(100.0, 0.7, 0.49)) == 0.0
    assert velocity_limit(Dimensionless(100.0, 0.7, 0.9), "corrected") == 0.0
    assert velocity_limit(Dimensionless(3.0, 0.9, 0.6, 1.25)) == 0.0  # too light for its delay


def test_mahvash_and_hayward() -> None:
    # printed: τ_D = 1, ξ̈_max = σ/(βτ_D), no quantisation: stable for β ≥ 2
    assert mahvash_hayward_margin(Dimensionless(100.0, 2.0, 0.7, 1.0)) == pytest.approx(0.0, abs=1e-15)
    assert mahvash_hayward_margin(Dimensionless(100.0, 2.01, 0.7, 1.0)) > 0.0
    assert mahvash_hayward_margin(Dimensionless(100.0, 1.99, 0.7, 1.0)) < 0.0


def worst_error(v: float) -> float:
    """Largest ∫(⌊χ⌋ − ⌊x⌋)dχ/v over [x, x + v] by scanning the place x of the edge and integrating tick by tick."""
    worst = 0.0
    for x in np.linspace(0.0, 1.0, 401)[:-1]:
        edges = [x, *range(1, math.ceil(x + v)), x + v]
        worst = max(worst, sum((b - a) * math.floor(0.5 * (a + b)) for a, b in itertools.pairwise(edges)))
    return worst / v


@pytest.mark.parametrize("v", [0.05, 0.7, 1.0, 1.41, 2.5, 6.02, 9.9])
def test_mean_error_is_the_supremum_over_edge_places(v: float) -> None:
    assert worst_error(v) <= float(mean_error(v)) + 1e-12
    assert float(mean_error(v)) == pytest.approx(worst_error(v), abs=0.0025 * (v + 1.0) / v)


@given(speeds)
def test_mean_error_lies_between_paper_and_corrected(v: float) -> None:
    w = float(mean_error(v))
    assert 0.5 * v + 0.5 - 1e-9 <= w <= 0.5 * v + 1.0 + 1e-9
    if v >= 1.0:
        # the largest ½r(1 − r)/v is at v = √2: (3/2 − √2)
        assert w <= 0.5 * v + 0.5 + 1.5 - math.sqrt(2.0) + 1e-9


@given(
    st.floats(0.0, 2.0) | st.just(0.0), st.floats(0.05, 60.0), st.just(0.0) | st.floats(0.0, 2.0), st.floats(0.0, 5.0)
)
def test_sharp_requirement_is_the_supremum_over_speeds(beta: float, top: float, tau_d: float, a: float) -> None:
    v = np.linspace(1e-9, top, 20_001)
    needed = mean_error(v) - beta * v + tau_d * np.minimum(top, v + (1.0 + tau_d) * a)
    ours = float(sharp_requirement(beta, top, tau_d, a))
    assert needed.max() <= ours + 1e-9
    assert ours == pytest.approx(needed.max(), rel=2e-3)


@given(st.floats(0.3, 1e3), betas, sigmas, st.floats(0.0, 2.0), st.floats(0.0, 100.0))
def test_sharp_is_never_stricter_than_corrected(mu: float, beta: float, sigma: float, tau_d: float, v: float) -> None:
    corrected = float(dissipation_margin(mu, beta, sigma, tau_d, v, "corrected"))
    sharp = float(dissipation_margin(mu, beta, sigma, tau_d, v, "sharp"))
    assert sharp >= corrected - 1e-9 * (1.0 + abs(corrected))


def test_case_c_of_fig_8_is_proven_only_by_the_sharp_form() -> None:
    n = Loop(6.28e-6, 9e-6, 2e-3, 0.012, 2.0 * math.pi / 8192 * 217, 1e-2).numbers
    v = float(velocity_bound(2.3, 0.0, n.mu))
    assert [criterion_margin(n, v, criterion) >= 0.0 for criterion in CRITERIA] == [True, False, True]


def test_counterexample_to_eq_12_in_region_a() -> None:
    # notes: μ = 100, β = σ = 0.51, ξ = 0.99, ξ̇ = 0.5: H_T 12.995 → 13.103 in one period
    n = Dimensionless(100.0, 0.51, 0.51)
    before, after = simulate(n, 0.99, 0.5, 1).energy()
    assert (before, after) == (pytest.approx(12.995, abs=5e-4), pytest.approx(13.103, abs=5e-4))
    v = float(velocity_bound(0.99, 0.5, 100.0))
    assert [criterion_margin(n, v, criterion) >= 0.0 for criterion in CRITERIA] == [True, False, False]


@pytest.mark.parametrize("criterion", ["corrected", "sharp"])
@pytest.mark.parametrize("delayed", [False, True])
def test_energy_never_rises_where_the_criterion_holds(criterion: Criterion, delayed: bool) -> None:
    rng = np.random.default_rng(12 if delayed else 11)
    points = 0
    while points < 250:
        mu, beta = (
            10 ** rng.uniform(0.0, 4.0),
            float(rng.choice([0.0, 10 ** rng.uniform(-3, 0.5), rng.uniform(0.3, 0.7)])),
        )
        tau_d = rng.uniform(0.0, 2.0) if delayed else 0.0
        xi, xi_dot = (
            float(rng.choice([0.0, rng.uniform(-3, 3), 1 - 1e-9])),
            10 ** rng.uniform(-2, 2) * rng.choice([-1, 1]),
        )
        top = float(velocity_bound(xi, xi_dot, mu, tau_d))
        # σ on the edge of the criterion, where a wrong constant would show; ξ̈_max contains σ/μ
        sigma = 0.0
        for _ in range(50):
            margin = float(dissipation_margin(mu, beta, sigma, tau_d, top, criterion))
            if margin >= 0.0:
                break
            sigma -= margin
        if not dissipation_margin(mu, beta, sigma * (1 + 1e-9), tau_d, top, criterion) >= 0.0:
            continue
        points += 1
        n = Dimensionless(mu, beta, sigma * (1 + 1e-9), tau_d)
        run = simulate(n, xi, xi_dot, 400)
        assert run.top_speed <= top * (1 + 1e-9), n
        assert run.top_acceleration <= float(xi_ddot_bound(mu, beta, n.sigma, top)) * (1 + 1e-9), n
        energy = run.energy("switches")[math.floor(tau_d) :]
        assert np.all(energy[1:] <= energy[:-1] * (1 + 1e-9)), n


def test_infinite_numbers_have_an_infinite_margin() -> None:
    n = Loop(1.0, 0.0, 0.0, 0.0, 1.0, 1.0).numbers
    assert criterion_margin(n, 1.0) == math.inf
    assert velocity_limit(n) == math.inf


def test_rest_margin_is_the_margin_at_vanishing_speed() -> None:
    assert float(rest_margin(2.0, 0.5, 0.4)) == pytest.approx(float(velocity_margin(9.9, 2.0, 0.0, 0.5, 0.4)))


@pytest.mark.parametrize(("beta", "top"), [(0.0, 0.4), (0.2, 5.3), (0.45, 1.4), (0.1, 40.6), (0.8, 3.0)])
def test_sharp_cannot_be_made_smaller(beta: float, top: float) -> None:
    # a heavy mass hardly changes its speed, so (40) is nearly attained; start just below an edge, at the worst speed
    v = np.linspace(1e-3, top, 5_001)
    worst = float(v[np.argmax(mean_error(v) - beta * v)])
    sigma = float(sharp_requirement(beta, top))
    below, above = (
        simulate(Dimensionless(1e9, beta, s), -1e-9, worst, 1).energy() for s in (sigma - 2e-3, sigma + 2e-3)
    )
    assert below[1] > below[0]
    assert above[1] < above[0]
