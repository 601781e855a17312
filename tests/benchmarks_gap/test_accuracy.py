"""The benchmark's small-step integration against scipy's solve_ivp with tight tolerances and located events."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.gap import physics
from benchmarks.gap.hidden import hide
from benchmarks.gap.physics import (
    BRISTLE,
    CURRENT,
    CURRENT_RATE,
    LOAD_OMEGA,
    LOAD_THETA,
    OMEGA,
    STATE_WORDS,
    THETA,
    Device,
)

BASE = Device(inertia=6.28e-6, viscous=9e-6, coulomb=2e-3, torque_constant=0.0292, delay_s=0.0, resolution=7.67e-4)
PERIOD = 1e-3
COMMANDS = np.repeat(np.array([0.1, -0.12, 0.02, -0.2, 0.15, 0.0, 0.09, -0.09]), 12)
STEP = 5e-6


def stepped(device: Device) -> np.ndarray:
    s = np.zeros(STATE_WORDS)
    found = []
    for k, command in enumerate(COMMANDS):
        physics.advance(device, s, k * PERIOD, (k + 1) * PERIOD, command, STEP)
        found.append(s.copy())
    return np.array(found)


def _solve(rate: Callable[..., list[float]], y: np.ndarray, t: float, end: float, **more: object) -> object:
    return solve_ivp(rate, (t, end), y, method="LSODA", rtol=1e-10, atol=1e-13, **more)


def test_stick_and_slip_follow_the_events_of_solve_ivp() -> None:
    reached = []
    theta, omega = 0.0, 0.0
    for k, command in enumerate(COMMANDS):
        t, end = k * PERIOD, (k + 1) * PERIOD
        torque = BASE.torque_constant * command
        while t < end:
            if omega == 0.0 and abs(torque) <= BASE.coulomb:
                break
            side = math.copysign(1.0, omega if omega != 0.0 else torque)

            def rate(_: float, y: np.ndarray, side: float = side, torque: float = torque) -> list[float]:
                return [y[1], (torque - BASE.viscous * y[1] - BASE.coulomb * side) / BASE.inertia]

            def at_rest(_: float, y: np.ndarray, side: float = side) -> float:
                return y[1] * side

            at_rest.terminal, at_rest.direction = True, -1.0  # type: ignore[attr-defined]
            done = _solve(rate, np.array([theta, omega]), t, end, events=at_rest)
            theta, omega, t = done.y[0, -1], done.y[1, -1], done.t[-1]
            if done.t_events[0].size:
                omega = 0.0
        reached.append([theta, omega])
    got = stepped(BASE)[:, [THETA, OMEGA]]
    want = np.array(reached)
    assert (want[:, 1] == 0.0).sum() > 5, "the shaft must stick for this to test anything"
    assert np.abs(got[:, 0] - want[:, 0]).max() < 1e-3 * BASE.resolution
    assert np.abs(got[:, 1] - want[:, 1]).max() < 1e-4


def _smooth(device: Device) -> np.ndarray:
    """All of the state by the equations written out again, for devices whose friction is a bristle."""

    def rate(t: float, y: np.ndarray, command: float = 0.0) -> list[float]:
        theta, omega, z, load_theta, load_omega, current, slope = y
        i = current if device.lag_omega else command
        sigma_0 = device.bristle_stiffness
        z_rate = omega - sigma_0 * abs(omega) * z / device.coulomb
        friction = sigma_0 * z + device.bristle_damping * z_rate + device.viscous * omega
        coupling = device.joint_stiffness * (theta - load_theta) + device.joint_damping * (omega - load_omega)
        load = device.inertia * device.load_share
        return [
            omega,
            (device.torque_constant * i - friction - coupling) / (device.inertia - load),
            z_rate,
            load_omega,
            coupling / load if load else 0.0,
            slope,
            device.lag_omega**2 * (command - current) - 2 * device.lag_damping * device.lag_omega * slope,
        ]

    y = np.zeros(STATE_WORDS)
    found = []
    for k, command in enumerate(COMMANDS):
        done = _solve(lambda t, y, u=command: rate(t, y, u), y, k * PERIOD, (k + 1) * PERIOD)
        y = done.y[:, -1]
        found.append(y)
    return np.array(found)


PRESLIDING = {"name": "presliding", "breakaway": 2e-3, "sigma_1": 1e-3}


@pytest.mark.parametrize(
    "more",
    [
        [],
        [{"name": "flexible_coupling", "f_r": 60.0, "load_share": 0.3, "damping": 0.03}],
        [{"name": "amplifier_lag", "f_a": 80.0, "delta": 0.6}],
    ],
    ids=["bristle", "coupling", "lag"],
)
def test_bristle_coupling_and_lag_follow_solve_ivp(more: list[dict[str, object]]) -> None:
    device = hide(BASE, [PRESLIDING, *more])
    got, want = stepped(device), _smooth(device)
    assert np.abs(got[:, THETA] - want[:, THETA]).max() < 2e-3 * device.resolution
    assert np.abs(got[:, OMEGA] - want[:, OMEGA]).max() < 2e-4 * np.abs(want[:, OMEGA]).max()
    assert np.abs(got[:, BRISTLE] - want[:, BRISTLE]).max() < 2e-6
    if device.load_share:
        assert np.abs(got[:, LOAD_THETA] - want[:, LOAD_THETA]).max() < 2e-3 * device.resolution
        assert np.abs(got[:, LOAD_OMEGA] - want[:, LOAD_OMEGA]).max() < 1e-3 * np.abs(want[:, LOAD_OMEGA]).max()
    if device.lag_omega:
        assert np.abs(got[:, CURRENT] - want[:, CURRENT]).max() < 1e-5
        assert np.abs(got[:, CURRENT_RATE] - want[:, CURRENT_RATE]).max() < 1e-2


def test_backlash_conserves_momentum_without_friction_and_keeps_the_load_near() -> None:
    device = hide(BASE._replace(viscous=0.0, coulomb=0.0), [{"name": "backlash", "gap": 4e-3, "load_share": 0.4}])
    got = stepped(device)
    momentum = device.inertia * (0.6 * got[:, OMEGA] + 0.4 * got[:, LOAD_OMEGA])
    impulse = np.cumsum(COMMANDS) * PERIOD * device.torque_constant
    assert np.abs(momentum - impulse).max() < 1e-9 * np.abs(impulse).max() + 1e-12
    penetration = np.abs(got[:, THETA] - got[:, LOAD_THETA]).max() - 2e-3
    assert 0.0 < penetration < 0.3 * device.resolution


def test_halving_the_step_hardly_moves_the_shaft() -> None:
    times = np.arange(COMMANDS.size) * PERIOD
    device = hide(BASE, [PRESLIDING])
    first = np.array([0])
    start = np.zeros((1, STATE_WORDS))
    coarse, fine = (
        physics.replay(device, times, COMMANDS, start, first, COMMANDS.size, step)[0] for step in (5e-6, 2.5e-6)
    )
    assert np.ptp(fine) > 100 * device.resolution
    assert np.abs(coarse - fine).max() < 2e-3 * device.resolution


def test_a_delayed_command_arrives_inside_a_period() -> None:
    device = BASE._replace(coulomb=0.0, viscous=0.0, delay_s=2.3e-3)
    times = np.arange(10) * PERIOD
    shown = physics.replay(device, times, np.full(10, 0.1), np.zeros((1, STATE_WORDS)), np.array([0]), 10, STEP)[0]
    moved = np.maximum(times - 2.3e-3, 0.0)
    want = 0.5 * 0.0292 * 0.1 / device.inertia * moved**2
    np.testing.assert_allclose(shown, want, rtol=1e-9, atol=1e-15)
