"""Colgate and Schenkel's bound and what it becomes with delay."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.config import apply_settings, load_config
from hapticd.stability.criterion import lambda_
from hapticd.stability.damping import Damper, passive_beta, passive_stiffness, passive_viscous
from hapticd.stability.numbers import Dimensionless, loop_from_config


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
    assert passive_beta(Dimensionless(1.0, 0.0, 0.0, 0.25), Damper(0.3, keep=0.9)) == float(lambda_(0.25, 0.3))


@pytest.mark.parametrize("delay", [0.0, 0.3e-3, 1e-3, 1.25e-3])
@pytest.mark.parametrize("stiffness", [0.0, 0.012])
def test_the_least_friction_and_the_largest_stiffness_are_one_border(delay: float, stiffness: float) -> None:
    ideal = {"amplifier.bandwidth_hz": 0, "delay.computation_s": delay, "spring.damping": 3e-6, "plant.viscous": 1e-5}
    config = apply_settings(load_config(None), {**ideal, "spring.stiffness": stiffness})
    loop = loop_from_config(config)
    K = float(passive_stiffness(config, loop, np.array([3e-6]))[0])
    at_border = apply_settings(config, {"spring.stiffness": K})
    assert passive_viscous(at_border) == pytest.approx(1e-5, rel=1e-12)
    if stiffness:
        damper = Damper(3e-6 / (stiffness * loop.period))
        assert passive_viscous(config) == pytest.approx(passive_beta(loop.numbers, damper) * stiffness * loop.period)
