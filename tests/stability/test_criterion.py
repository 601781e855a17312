"""(12) to (19) as printed, and as the criterion on S has them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.reproduce.table_1 import mahvash_hayward_margin
from hapticd.stability.criterion import (
    criterion_margin,
    dissipation_margin,
    lambda_,
    passive_margin,
    sampling_bound_ok,
    sampling_ratio,
    velocity_limit,
)
from hapticd.stability.numbers import Dimensionless, Loop
from hapticd.stability.storage import velocity_bound

from .motion import simulate

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
    assert float(dissipation_margin(beta, sigma, 0.0, v)) == pytest.approx(min(v * printed, sigma - 0.5), abs=1e-9)


@given(betas, sigmas, speeds, st.floats(0.0, 3.0), st.floats(0.5, 3.0))
def test_the_margin_is_the_balance_at_its_worst_speed(
    beta: float, sigma: float, v: float, tau_d: float, q: float
) -> None:
    speed = np.linspace(0.0, v, 17)
    balance = speed * (beta - float(lambda_(tau_d))) + sigma - q
    assert float(dissipation_margin(beta, sigma, tau_d, v, q)) == pytest.approx(balance.min(), abs=1e-9)


def test_eq_16_in_si_units() -> None:
    # (b − KT/2) + c/ẋ_max, over KΔ and times ẋ_max, is the unquantised margin
    loop = Loop(0.1, 0.3, 0.2, 900.0, 3e-5, 1e-3)
    n, v_si = loop.numbers, 0.4
    printed = (loop.viscous - 900.0 * 1e-3 / 2.0) + loop.coulomb / v_si
    ours = float(dissipation_margin(n.beta, n.sigma, 0.0, loop.scales.velocity_to_xi_dot(v_si), quantum=0.0))
    assert loop.scales.phi_to_force(ours) == pytest.approx(printed * v_si)


def test_eq_15_in_si_units() -> None:
    loop = Loop(0.22, 0.01, 0.147, 14500.0, 10e-6, 1e-3 / 3.0)  # Omega
    printed = (2 * 0.147 - 14500.0 * 10e-6) / (14500.0 * 1e-3 / 3.0 - 2 * 0.01)
    assert loop.scales.xi_dot_to_velocity(velocity_limit(loop.numbers)) == pytest.approx(printed)


@pytest.mark.parametrize("tau_d", [0.0, 0.3, 1.25])
@pytest.mark.parametrize("quantum", [0.5, 2.0])
def test_velocity_limit_is_where_the_margin_changes_sign(tau_d: float, quantum: float) -> None:
    n = Dimensionless(400.0, 0.2, 3.0, tau_d, quantum=quantum)
    limit = velocity_limit(n)
    assert criterion_margin(n, limit * (1 - 1e-9)) >= 0.0
    assert criterion_margin(n, limit * (1 + 1e-9)) < 0.0


def test_velocity_limit_extremes() -> None:
    assert velocity_limit(Dimensionless(100.0, 0.5, 0.5)) == math.inf
    assert velocity_limit(Dimensionless(100.0, 0.7, 0.49)) == 0.0
    assert velocity_limit(Dimensionless(100.0, 0.7, 0.9, quantum=1.0)) == 0.0
    assert velocity_limit(Dimensionless(100.0, float(lambda_(1.25)), 0.6, 1.25)) == math.inf
    assert 0.0 < velocity_limit(Dimensionless(100.0, 1.75, 0.6, 1.25)) < math.inf


@pytest.mark.parametrize(
    ("tau_d", "more"), [(0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (0.074, 0.05), (0.25, 0.077), (0.5, 0.059)]
)
def test_lambda_is_half_and_the_delay_and_a_little_more_between(tau_d: float, more: float) -> None:
    assert float(lambda_(tau_d)) == pytest.approx((0.5 + tau_d) * (1.0 + more), rel=2e-3 if more else 1e-15)
    assert float(lambda_(tau_d)) >= 0.5 + tau_d


@given(st.floats(0.0, 5.0), st.floats(1e-6, 1.0), st.floats(0.0, 3.0))
def test_lambda_and_the_period_times_it_rise_with_the_delay(tau_d: float, more: float, beta_v: float) -> None:
    """Then limits on K, T and T_D have one solution (`hapticd.stability.tuning`)."""
    assert float(lambda_(tau_d + more, beta_v)) > float(lambda_(tau_d, beta_v))
    T = 1.0 + more
    assert T * float(lambda_(tau_d / T)) > float(lambda_(tau_d))
    assert float(lambda_(tau_d, beta_v)) <= float(lambda_(tau_d)) + beta_v + 1e-12


@pytest.mark.parametrize("tau_d", [0.25, 0.5, 1.5])
def test_less_than_lambda_is_not_passive(tau_d: float) -> None:
    """A motion in step with the servo, moved by a hand, takes energy out in every period without end if β < λ (no ticks)."""
    f = tau_d % 1.0
    matrix = np.array([[0.5 + tau_d // 1 + 1.0, 0.0], [0.0, 0.5 + tau_d // 1]]) * np.array([[f, 0.0], [0.0, 1.0 - f]])
    matrix[0, 1] = matrix[1, 0] = (1.0 + tau_d // 1) * math.sqrt(f * (1.0 - f))
    values, vectors = np.linalg.eigh(matrix)
    speed = np.abs(vectors[:, -1]) / np.sqrt([f, 1.0 - f])
    assert values[-1] == pytest.approx(float(lambda_(tau_d)))
    beta = 0.99 * float(lambda_(tau_d))
    cells = 400
    way = np.tile(np.where(np.arange(cells) < f * cells, *speed) / cells, 12)
    place = np.concatenate([[0.0], np.cumsum(way)])
    late = round(tau_d * cells)
    held = np.array([place[cells * ((i - late) // cells)] if i >= late else 0.0 for i in range(way.size)])
    work = (place[:-1] + 0.5 * way - held - beta * way * cells) * way
    assert work[-cells:].sum() > 0.0
    assert (work[-cells:] + (beta - 1.01 * float(lambda_(tau_d))) * way[-cells:] ** 2 * cells).sum() < 0.0


def test_mahvash_and_hayward() -> None:
    # printed: τ_D = 1, ξ̈_max = σ/(βτ_D), no quantisation: stable for β ≥ 2
    assert mahvash_hayward_margin(2.0, 0.7, 1.0) == pytest.approx(0.0, abs=1e-15)
    assert mahvash_hayward_margin(2.01, 0.7, 1.0) > 0.0
    assert mahvash_hayward_margin(1.99, 0.7, 1.0) < 0.0
    # theorem 2 asks for less
    assert float(lambda_(1.0)) == 1.5


def test_where_the_papers_energy_rises_s_falls() -> None:
    # notes: μ = 100, β = σ = 0.51, ξ = 0.99, ξ̇ = 0.5: H_T 12.995 → 13.103 in one period
    n = Dimensionless(100.0, 0.51, 0.51)
    run = simulate(n, 0.99, 0.5, 1)
    before, after = run.energy()
    assert (before, after) == (pytest.approx(12.995, abs=5e-4), pytest.approx(13.103, abs=5e-4))
    first, last = (0.5 * (100.0 * v * v + x * x) for x, v in run.samples)
    assert last < first
    assert criterion_margin(n, float(velocity_bound(0.99, 0.5, 100.0))) >= 0.0


def test_infinite_numbers_have_an_infinite_margin() -> None:
    n = Loop(1.0, 0.0, 0.0, 0.0, 1.0, 1.0).numbers
    assert criterion_margin(n, 1.0) == math.inf
    assert velocity_limit(n) == math.inf


def test_without_a_velocity_the_margin_is_of_all() -> None:
    n = Dimensionless(100.0, 1.9, 0.8, 1.25)
    assert criterion_margin(n, None) == min(passive_margin(n), 0.8 - 0.5)
