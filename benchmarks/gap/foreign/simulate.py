"""One machine with one degree of freedom under a controller, in small steps.

    J ω̇ = K_t i − f(ω) − σ₀ z − σ₁ ż − G sin(θ − θ₀) + Σ a_k sin(kθ + φ_k) + τ₀ + disturbance
    ż = ω − σ₀ |ω| z / g(ω),   g(ω) = c (1 + s exp(−(ω/ω_s)²)),   σ₀ = c / breakaway          (LuGre)
    f(ω) = b (1 ± a) ω (1 + |ω|/ω_d)^(p − 1)                        (p < 1: grows less than linearly; 1: viscous)
    τ_e di/dt = command(t − T_d) − i,   τ_r dr/dt = i − r           (current loop; what the drive reports)

Leapfrog: velocities at half steps, f implicit, the bristle exact at constant velocity, the current exact. The controller
sees quantised positions; its velocity is a filtered difference.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_STEPS_A_PERIOD = 40.0
"""Of the shaft on its bristles."""
_LONGEST_STEP_S = 1e-4


class Machine(NamedTuple):
    """What is simulated; rotary units, linear ones alike."""

    inertia: float
    viscous: float
    coulomb: float
    torque_constant: float
    resolution: float
    breakaway: float
    bristle_damping: float = 0.0
    stribeck: float = 0.0
    stribeck_speed: float = 1.0
    exponent: float = 1.0
    bend_speed: float = 1.0
    asymmetry: float = 0.0
    gravity: float = 0.0
    hangs_at: float = 0.0
    bias: float = 0.0
    orders: tuple[float, ...] = (1.0,)
    amplitudes: tuple[float, ...] = (0.0,)
    phases: tuple[float, ...] = (0.0,)
    current_lag_s: float = 0.0
    report_lag_s: float = 0.0


class Loop(NamedTuple):
    """The controller: torque = kp (r − θ) + kd (ṙ − v) + ki ∫ (r − θ) + feed, within ± limit."""

    kp: float
    kd: float
    ki: float
    velocity_filter_s: float
    limit: float
    every: int
    """Ticks of the simulation in one of the controller."""
    delay: int
    """Ticks until the command reaches the current loop."""


class Motion(NamedTuple):
    """What was, at every tick; all of shape (n,)."""

    position: Floats
    velocity: Floats
    current: Floats
    reported: Floats
    command: Floats


@njit(cache=True)
def kinetic(m: Machine, speed: float) -> float:
    """Steady friction of the bristles at a speed ≥ 0."""
    ratio = speed / m.stribeck_speed
    return m.coulomb * (1.0 + m.stribeck * math.exp(-ratio * ratio))


@njit(cache=True)
def damping(m: Machine, velocity: float) -> float:
    """f(ω) / ω."""
    side = 1.0 + m.asymmetry if velocity > 0.0 else 1.0 - m.asymmetry
    return m.viscous * side * (1.0 + abs(velocity) / m.bend_speed) ** (m.exponent - 1.0)


@njit(cache=True)
def _force(m: Machine, position: float) -> float:
    torque = m.bias - m.gravity * math.sin(position - m.hangs_at)
    for k in range(len(m.orders)):
        torque += m.amplitudes[k] * math.sin(m.orders[k] * position + m.phases[k])
    return torque


@njit(cache=True)
def _play(
    m: Machine, loop: Loop, reference: Floats, rate: Floats, feed: Floats, disturbance: Floats,
    tick_s: float, steps: int, start: float,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:  # fmt: skip
    n = reference.size
    theta_out, omega_out = np.empty(n), np.empty(n)
    current_out, reported_out, command_out = np.empty(n), np.empty(n), np.empty(n)
    h, sigma = tick_s / steps, m.coulomb / m.breakaway
    keep = math.exp(-h / m.current_lag_s) if m.current_lag_s > 0.0 else 0.0
    keep_reported = math.exp(-h / m.report_lag_s) if m.report_lag_s > 0.0 else 0.0
    every_s = loop.every * tick_s
    smooth = 1.0 - math.exp(-every_s / loop.velocity_filter_s) if loop.velocity_filter_s > 0.0 else 1.0
    theta, omega, z, slip = start, 0.0, 0.0, 0.0
    current, reported, integral, seen_rate, command = 0.0, 0.0, 0.0, 0.0, 0.0
    last = math.floor(theta / m.resolution) * m.resolution
    for k in range(n):
        if k % loop.every == 0:
            seen = math.floor(theta / m.resolution) * m.resolution
            seen_rate += smooth * ((seen - last) / every_s - seen_rate)
            last = seen
            error = reference[k] - seen
            wanted = loop.kp * error + loop.kd * (rate[k] - seen_rate) + loop.ki * integral + feed[k]
            held = min(max(wanted, -loop.limit), loop.limit)
            if held == wanted:
                integral += every_s * error
            command = held / m.torque_constant
        command_out[k] = command
        theta_out[k], current_out[k], reported_out[k] = theta, current, reported
        target = command_out[k - loop.delay] if k >= loop.delay else 0.0
        before = omega
        for step in range(steps):
            current = target + (current - target) * keep
            reported = current + (reported - current) * keep_reported
            torque = (
                m.torque_constant * current + _force(m, theta) + disturbance[k] - sigma * z - m.bristle_damping * slip
            )
            half = 0.5 * h * damping(m, omega) / m.inertia
            first = 0.5 if k == 0 and step == 0 else 1.0
            omega = (omega * (1.0 - half) + first * h * torque / m.inertia) / (1.0 + half)
            theta += h * omega
            if omega != 0.0 and m.coulomb > 0.0:
                end = kinetic(m, abs(omega)) / sigma * (1.0 if omega > 0.0 else -1.0)
                after = end + (z - end) * math.exp(-h * omega / end)
                slip, z = (after - z) / h, after
            else:
                slip = 0.0
            if step == 0:
                omega_out[k] = 0.5 * (before + omega)
    return theta_out, omega_out, current_out, reported_out, command_out


def play(
    machine: Machine,
    loop: Loop,
    reference: Floats,
    feed: Floats,
    disturbance: Floats,
    tick_s: float,
    start: float = 0.0,
) -> Motion:
    """Run a machine from rest.

    Args:
        machine: it. loop: its controller. reference: (n,) rad or m. feed: (n,) torque that is added to the controller's.
        disturbance: (n,) torque. tick_s: time between two of them, s. start: first position.
    """
    stiffness = machine.coulomb / machine.breakaway if machine.coulomb else 0.0
    longest = min(
        _LONGEST_STEP_S, 2.0 * math.pi * math.sqrt(machine.inertia / max(stiffness, 1e-300)) / _STEPS_A_PERIOD
    )
    steps = max(1, math.ceil(tick_s / longest))
    return Motion(
        *_play(machine, loop, reference, np.gradient(reference, tick_s), feed, disturbance, tick_s, steps, start)
    )
