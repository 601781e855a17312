"""Colgate and Schenkel's bound and the criterion with a damper in it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.stability.damping import Damper, damped_margin, passive_beta
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.sampled_loop import loop_record, run_loops


def numeric_bound(K: float, B: float, T: float, weights: list[float]) -> float:
    """Their theorem itself: max of T Re{(1 − e^(−jθ)) H} / (2 (1 − cos θ)), H = K + (B/T) Σ w_k z^(1−k) (1 − z⁻¹)."""
    theta = np.linspace(1e-3, np.pi, 4_001)
    z = np.exp(1j * theta)
    H = K + B / T * sum(w * z ** (-k) for k, w in enumerate(weights)) * (1.0 - 1.0 / z)
    return float((T * np.real((1.0 - 1.0 / z) * H) / (2.0 * (1.0 - np.cos(theta)))).max())


@pytest.mark.parametrize("periods", [1, 2, 3, 10, 200])
def test_the_bound_is_the_theorem_for_differences(periods: int) -> None:
    K, B, T = 3.0, 0.7, 0.01
    damper = Damper(B / (K * T), periods)
    expected = numeric_bound(K, B, T, [1.0 / periods] * periods)
    assert passive_beta(Dimensionless(1.0, 0.0, 0.0), damper) * K * T == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize("keep", [0.1, 0.5, 0.9])
def test_the_bound_is_the_theorem_for_the_low_pass(keep: float) -> None:
    K, B, T = 3.0, 0.7, 0.01
    weights = [(1.0 - keep) * keep**k for k in range(150)]
    expected = numeric_bound(K, B, T, weights)
    found = passive_beta(Dimensionless(1.0, 0.0, 0.0), Damper(B / (K * T), keep=keep)) * K * T
    assert found == pytest.approx(expected, rel=1e-4)


def test_one_period_is_colgate_and_schenkels() -> None:
    assert passive_beta(Dimensionless(1.0, 0.0, 0.0), Damper(0.3)) == 0.8
    assert passive_beta(Dimensionless(1.0, 0.0, 0.0, 0.25), Damper(0.3, keep=0.9)) == pytest.approx(1.05)


@settings(max_examples=60, deadline=None)
@given(
    beta=st.floats(0.5, 4.0),
    beta_v=st.floats(0.0, 2.0),
    periods=st.sampled_from([1, 2, 5]),
    keep=st.sampled_from([0.0, 0.7]),
    tau_d=st.sampled_from([0.0, 0.5]),
    speed=st.floats(0.2, 20.0),
)
def test_where_the_criterion_holds_energy_falls_in_every_period(
    beta: float, beta_v: float, periods: int, keep: float, tau_d: float, speed: float
) -> None:
    damper = Damper(beta_v, periods if keep == 0.0 else 1, keep)
    short = -damped_margin(Dimensionless(200.0, beta, 0.0, tau_d), damper, speed)
    # σ is in ξ̈_max too, times τ_D² + τ_D over μ
    sigma = max(short, 0.0) / (1.0 - (tau_d**2 + tau_d) / 200.0) + 1e-9
    numbers = Dimensionless(200.0, beta, sigma, tau_d)
    assert damped_margin(numbers, damper, speed) >= 0.0
    run = run_loops(loop_record(numbers, damper, np.zeros(1), np.array([speed])), 3000)[0]
    assert run["outcome"] in (0, 1)
    if tau_d == 0.0:  # with delay energies fall at h + τ_D, and these are at the samples
        assert not run["rose"]


def test_the_grain_costs_coulomb_friction() -> None:
    numbers = Dimensionless(100.0, 2.0, 1.5)
    assert damped_margin(numbers, Damper(0.5, 1), 0.0) == pytest.approx(0.0)
    assert damped_margin(numbers, Damper(0.5, 5), 0.0) == pytest.approx(0.4)
