from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.stability.numbers import Dimensionless, Loop, Scales, from_config, loop_from_config, physical

positive = st.floats(1e-6, 1e6)


def test_printed_table_ii_phantom() -> None:
    # Table II, Phantom 1.0: m 0.072 kg, c 0.038 N, Δ 29.1 µm, T 1 ms, K 1015 N/m; printed σ = 1.29
    n = Loop(0.072, 0.005, 0.038, 1015.0, 29.1e-6, 1e-3).numbers
    assert n.mu == pytest.approx(70.936, abs=1e-3)
    assert n.sigma == pytest.approx(1.29, abs=5e-3)
    assert n.beta == pytest.approx(0.004926, abs=1e-6)


@pytest.mark.parametrize(
    ("rate", "decimation", "mu", "beta", "sigma"),
    [(1000, 217, 523, 0.75, 1.00), (1000, 2172, 523, 0.75, 0.10), (100, 217, 5.23, 0.075, 1.00)],
)
def test_operating_points_of_fig_8(rate: float, decimation: int, mu: float, beta: float, sigma: float) -> None:
    n = Loop(6.28e-6, 9e-6, 2e-3, 0.012, 2.0 * math.pi / 8192 * decimation, 1.0 / rate).numbers
    assert (n.mu, n.beta, n.sigma) == (
        pytest.approx(mu, rel=2e-3),
        pytest.approx(beta, rel=1e-9),
        pytest.approx(sigma, rel=2e-3),
    )


@given(positive, positive, positive, positive, positive, positive, positive, positive)
def test_table_i_both_ways(
    m: float, b: float, c: float, K: float, delta: float, T: float, td: float, kh: float
) -> None:
    loop = Loop(m, b, c, K, delta, T, td, kh)
    back = physical(loop.numbers, loop.scales)
    for name in ("inertia", "viscous", "coulomb", "stiffness", "resolution", "period", "delay", "hand_stiffness"):
        assert getattr(back, name) == pytest.approx(getattr(loop, name), rel=1e-12)


@pytest.mark.parametrize(
    ("there", "back", "unit"),
    [
        ("time_to_tau", "tau_to_time", 2e-3),
        ("position_to_xi", "xi_to_position", 5e-4),
        ("velocity_to_xi_dot", "xi_dot_to_velocity", 5e-4 / 2e-3),
        ("force_to_phi", "phi_to_force", 0.012 * 5e-4),
    ],
)
def test_every_signal_is_measured_in_its_unit(there: str, back: str, unit: float) -> None:
    scales = Scales(stiffness=0.012, resolution=5e-4, period=2e-3)
    values = np.array([-3.0, 0.0, 7.5])
    np.testing.assert_allclose(getattr(scales, there)(values * unit), values, rtol=1e-14)
    np.testing.assert_allclose(getattr(scales, back)(values), values * unit, rtol=1e-14)


def test_half_the_sampling_rate_is_half_a_turn_per_period() -> None:
    scales = Scales(1.0, 1.0, 1e-3)
    assert scales.omega_to_hz(math.pi) == pytest.approx(500.0)


def config(**hand: float) -> SimpleNamespace:
    return SimpleNamespace(
        period=1e-3,
        resolution=2e-3,
        spring=SimpleNamespace(stiffness=0.012, damping=0.0),
        amplifier=SimpleNamespace(
            delay=2 * 0.7 / (2 * math.pi * 3000), dac_bits=14, dac_full_scale=6.0, torque_constant=0.0292
        ),
        dither=SimpleNamespace(target="position", amplitude=0.3),
        encoder=SimpleNamespace(decimation=2),
        delay=SimpleNamespace(computation_s=0.25e-3),
        plant=SimpleNamespace(inertia=6.28e-6, viscous=9e-6, coulomb=2e-3, effects=()),
        hand=SimpleNamespace(**{"inertia": 0.0, "damping": 0.0, "stiffness": 0.0} | hand),
    )


def test_delay_is_amplifier_plus_computation_plus_driver() -> None:
    n = from_config(config(), latency_s=0.1e-3)
    assert n.tau_d == pytest.approx(0.0742723 + 0.25 + 0.1, abs=1e-6)
    assert n.tau_l == pytest.approx(n.tau_d + 0.5)


def test_the_largest_error_of_a_force_is_that_of_ticks_dither_and_converter() -> None:
    # ±0.3 ticks of 2 counts may move the reading by one count, half a tick; half a step is 6 A/2¹⁴ times the torque constant
    assert from_config(config()).quantum == pytest.approx(0.5 + 0.5 + 6.0 / 2**14 * 0.0292 / (0.012 * 2e-3))
    assert Dimensionless(1.0, 1.0, 1.0).quantum == 0.5


def test_hand_is_in_parallel() -> None:
    bare, held = from_config(config()), from_config(config(inertia=6.28e-6, damping=18e-6, stiffness=0.006))
    assert held.mu == pytest.approx(2.0 * bare.mu)
    assert held.beta == pytest.approx(3.0 * bare.beta)
    assert (held.sigma, held.kappa) == (bare.sigma, 0.5)


def test_no_spring_is_infinite_friction() -> None:
    bare = loop_from_config(config())
    n = Loop(bare.inertia, bare.viscous, bare.coulomb, 0.0, bare.resolution, bare.period).numbers
    assert math.isinf(n.mu)
    assert math.isinf(n.beta)
    assert math.isinf(n.sigma)


@pytest.mark.parametrize("wrong", [{"mu": 0.0}, {"mu": math.nan}, {"beta": -1.0}, {"sigma": math.nan}, {"tau_d": -0.1}])
def test_impossible_numbers_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Dimensionless(**{"mu": 1.0, "beta": 0.5, "sigma": 0.5} | wrong)
