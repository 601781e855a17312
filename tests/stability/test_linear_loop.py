"""The linear loop: its boundary against the spectral radius of its matrix, its impedance against motion by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from hapticd.stability.linear_loop import VelocityFilter, effective, impedance, largest_damping, largest_stable
from hapticd.stability.numbers import Loop

DEVICE = Loop(inertia=0.072, viscous=0.3, coulomb=0.0, stiffness=1015.0, resolution=29.1e-6, period=1e-3)
ARM = DEVICE.with_hand(0.15, 4.8, 600.0)
CASES = [
    (DEVICE, (1, 0.0)),
    (replace(DEVICE, delay=0.3e-3), (1, 0.0)),
    (replace(DEVICE, delay=2.25e-3), (4, 0.0)),
    (replace(ARM, delay=1.5e-3), (1, 0.7)),
    (ARM, (7, 0.0)),
    (replace(DEVICE, viscous=0.0, delay=1e-3), (1, 0.0)),
]


def spectral_radius(loop: Loop, velocity: VelocityFilter, K: float, B: float) -> float:
    """Of the closed loop as a matrix: position, velocity, positions and forces of before, the low-pass."""
    T, (window, keep) = loop.period, velocity
    whole = int(loop.delay // T)
    late = loop.delay - whole * T
    flow = np.array(
        [[0, 1, 0], [-loop.hand_stiffness / loop.inertia, -loop.viscous / loop.inertia, 1 / loop.inertia], [0, 0, 0]]
    )
    first, second = expm(late * flow), expm((T - late) * flow)
    size = 2 + window + (whole + 1) + 1
    past, forces, low = 2, 2 + window, size - 1
    # the estimate and the force of this sample, as rows over the state
    estimate = np.zeros(size)
    estimate[0] += (1 - keep) / (window * T)
    estimate[past + window - 1] -= (1 - keep) / (window * T)
    estimate[low] += keep
    force = -B * estimate
    force[0] -= K
    commands = [force, *(np.eye(size)[forces + k] for k in range(whole + 1))]
    step = np.zeros((size, size))
    step[:2, :2] = (second @ first)[:2, :2]
    step[:2] += np.outer((second[:2, :2] @ first[:2, 2]), commands[whole + 1])
    step[:2] += np.outer(second[:2, 2], commands[whole])
    step[past, 0] = 1.0
    for k in range(1, window):
        step[past + k, past + k - 1] = 1.0
    step[forces] = force
    for k in range(1, whole + 1):
        step[forces + k, forces + k - 1] = 1.0
    step[low] = estimate
    return float(np.abs(np.linalg.eigvals(step)).max())


@pytest.mark.parametrize(("loop", "velocity"), CASES)
def test_the_boundary_is_where_the_spectral_radius_is_one(loop: Loop, velocity: VelocityFilter) -> None:
    B = np.linspace(0.0, 0.95, 6) * largest_damping(loop, velocity)
    for b, K in zip(B.tolist(), largest_stable(loop, velocity, B).tolist(), strict=True):
        if K > 0.0:
            assert spectral_radius(loop, velocity, 0.999 * K, b) < 1.0
        assert spectral_radius(loop, velocity, 1.001 * K + 1e-3, b) > 1.0


@pytest.mark.parametrize(("loop", "velocity"), CASES)
def test_all_below_the_boundary_is_stable(loop: Loop, velocity: VelocityFilter) -> None:
    B = np.linspace(0.05, 0.9, 4) * largest_damping(loop, velocity)
    for b, K in zip(B.tolist(), largest_stable(loop, velocity, B).tolist(), strict=True):
        assert all(spectral_radius(loop, velocity, share * K, b) < 1.0 for share in (0.01, 0.1, 0.3, 0.5, 0.7, 0.9))


def test_without_friction_and_delay_it_is_a_formula() -> None:
    """Jury's criterion of z³ − 2z² + z + (z + 1)((α + β)z − β)/2: KT²/m ≤ 2β(2 − β)/(2 + β), β = BT/m."""
    loop = replace(DEVICE, viscous=0.0)
    beta = np.linspace(0.02, 1.95, 9)
    unit = loop.inertia / loop.period
    found = largest_stable(loop, (1, 0.0), np.append(beta, 2.01) * unit) * loop.period / unit
    np.testing.assert_allclose(found[:-1], 2 * beta * (2 - beta) / (2 + beta), rtol=5e-4)
    assert found[-1] == 0.0


@pytest.mark.parametrize("delay", [0.0, 0.3e-3, 1e-3, 2.5e-3])
def test_for_little_damping_it_is_the_linear_condition(delay: float) -> None:
    """K (T/2 + T_D) < b + B (J. J. Gil and others, ASME J. Computing and Information Science in Engineering 9, 2009)."""
    loop = replace(DEVICE, viscous=0.02, delay=delay)
    B = np.array([0.0, 0.02, 0.05])
    found = largest_stable(loop, (1, 0.0), B)
    np.testing.assert_allclose(found, (0.02 + B) / (0.5e-3 + delay), rtol=0.02)


def test_a_window_of_hundreds_of_periods_has_a_boundary() -> None:
    B = np.array([0.0, 0.1, 0.3])
    found = largest_stable(DEVICE, (300, 0.0), B)
    assert found[0] == pytest.approx(largest_stable(DEVICE, (1, 0.0), B)[0], rel=1e-3)
    for b, K in zip(B.tolist(), found.tolist(), strict=True):
        assert K == 0.0 or spectral_radius(DEVICE, (300, 0.0), 0.99 * K, b) < 1.0
        assert spectral_radius(DEVICE, (300, 0.0), 1.01 * K + 1e-3, b) > 1.0


@pytest.mark.parametrize("velocity", [(1, 0.0), (5, 0.0), (1, 0.8)])
@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 1.75e-3])
def test_slow_motions_feel_stiffness_and_damping_of_the_spring(velocity: VelocityFilter, delay: float) -> None:
    loop = replace(DEVICE, damping=2.0, delay=delay)
    K, B = effective(loop, velocity, np.array([0.01]))
    assert K[0] == pytest.approx(loop.stiffness, rel=1e-5)
    assert B[0] == pytest.approx(loop.viscous + loop.damping - loop.stiffness * (0.5e-3 + delay), rel=1e-4)


def felt(loop: Loop, velocity: VelocityFilter, hertz: float) -> complex:
    """The impedance by moving the device along a cosine, sampling, holding, and taking the first harmonic of the force."""
    T, (window, keep) = loop.period, velocity
    rate, cycles, fine = 2 * np.pi * hertz, 20, 400
    periods = round(cycles / (hertz * T))
    assert periods * hertz * T == pytest.approx(cycles)
    start = -400
    positions = np.cos(rate * T * np.arange(start - window, periods))
    estimate, forces = 0.0, []
    for k in range(window, positions.size):
        estimate = keep * estimate + (1 - keep) * (positions[k] - positions[k - window]) / (window * T)
        forces.append(-loop.stiffness * positions[k] - loop.damping * estimate)
    t: NDArray[np.float64] = (np.arange(periods * fine) + 0.5) * T / fine
    held = np.array(forces)[np.floor((t - loop.delay) / T).astype(int) - start]
    x, v, a = np.cos(rate * t), -rate * np.sin(rate * t), -(rate**2) * np.cos(rate * t)
    hand = loop.inertia * a + loop.viscous * v - held
    turning = np.exp(-1j * rate * t)
    return complex((hand @ turning) / (x @ turning) / (1j * rate))


@pytest.mark.parametrize(("hertz", "velocity"), [(10.0, (1, 0.0)), (100.0, (3, 0.0)), (400.0, (1, 0.5))])
@pytest.mark.parametrize("delay", [0.0, 1.25e-3])
def test_the_impedance_is_what_a_hand_feels(hertz: float, velocity: VelocityFilter, delay: float) -> None:
    loop = replace(DEVICE, damping=2.0, delay=delay)
    found = impedance(loop, velocity, np.array([hertz]))[0]
    assert abs(found - felt(loop, velocity, hertz)) < 1e-4 * abs(found)
