"""A second, independent simulation of a haptic device: every effect's law in one place, integrated in small steps.

    J ω̇ = K_t i − b ω − c sgn(ω), with stiction, and whatever the effects add (see `Device` for the symbols).

Midpoint rule with a step of a few µs, cut at every switch of the current; the instant at which the velocity changes sign
is interpolated, and the shaft then sticks or slips. The encoder floors, the loop is closed at the recorded instants.
Nothing here comes from ``hapticd``, so that the two agree only where both are right.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

THETA, OMEGA, BRISTLE, LOAD_THETA, LOAD_OMEGA, CURRENT, CURRENT_RATE = range(7)
STATE_WORDS = 7


class Device(NamedTuple):
    """What is simulated: a base device and every effect at its neutral value. Rotary units; linear ones alike."""

    inertia: float
    viscous: float
    coulomb: float
    torque_constant: float
    delay_s: float
    resolution: float
    viscous_asymmetry: float = 0.0
    coulomb_offset: float = 0.0
    stribeck_s: float = 0.0
    stribeck_omega: float = 1.0
    bristle_breakaway: float = 0.0
    bristle_stiffness: float = 0.0
    bristle_damping: float = 0.0
    quadratic_drag: float = 0.0
    load_friction: float = 0.0
    bias: float = 0.0
    gravity: float = 0.0
    gravity_theta: float = 0.0
    spring: float = 0.0
    spring_theta: float = 0.0
    lag_omega: float = 0.0
    lag_damping: float = 0.7
    current_limit: float = math.inf
    dac_step: float = 0.0
    backlash_half: float = 0.0
    load_share: float = 0.0
    joint_stiffness: float = 0.0
    joint_damping: float = 0.0
    eccentricity: float = 0.0
    eccentricity_phase: float = 0.0
    eccentricity_2: float = 0.0
    eccentricity_2_phase: float = 0.0
    drift: float = 0.0
    drift_time_s: float = 1.0
    hand_inertia: float = 0.0
    hand_damping: float = 0.0
    hand_stiffness: float = 0.0
    hand_theta: float = 0.0
    hand_on_s: float = 0.0
    hand_off_s: float = 0.0
    ripple: NDArray[np.float64] = np.zeros((0, 3))
    """Shape (orders, 3): k per radian, amplitude, phase."""
    coloured: NDArray[np.float64] = np.zeros(0)
    """Torque from outside at multiples of ``coloured_step_s``, linear between; none by default."""
    coloured_step_s: float = 1.0


class Loop(NamedTuple):
    """The virtual spring of the recording session, as the lab's controller renders it, and its limits."""

    stiffness: float
    torque_constant: float
    decimation: int
    dac_step: float
    peak_current: float
    max_omega: float
    max_theta: float


@njit(cache=True)
def gripped(d, t):
    """Whether the hand holds the device at time t."""
    return d.hand_on_s <= t < d.hand_off_s


@njit(cache=True)
def coulomb_level(d, t, omega, current):
    """Magnitude of the sliding friction; at ω = 0 the largest stiction."""
    level = d.coulomb
    if d.drift != 0.0:
        level *= 1.0 + d.drift * (1.0 - math.exp(-t / d.drift_time_s))
    if d.stribeck_s != 0.0:
        level *= 1.0 + d.stribeck_s * math.exp(-((omega / d.stribeck_omega) ** 2))
    return level + d.load_friction * abs(d.torque_constant * current)


@njit(cache=True)
def torque_from_outside(d, t):
    """The coloured torque at time t; beyond its ends the value there."""
    last = d.coloured.size - 1
    at = min(max(t / d.coloured_step_s, 0.0), float(last))
    k = min(int(at), last - 1)
    return d.coloured[k] + (at - k) * (d.coloured[k + 1] - d.coloured[k])


@njit(cache=True)
def drive(d, t, theta, omega, current):
    """Torque on the motor from everything but dry friction and the joint to the load."""
    torque = d.torque_constant * current + d.bias - d.coulomb_offset
    side = 1.0 if omega > 0.0 else -1.0
    torque -= d.viscous * (1.0 + side * d.viscous_asymmetry) * omega
    torque -= d.quadratic_drag * omega * abs(omega)
    if d.gravity != 0.0:
        torque -= d.gravity * math.sin(theta - d.gravity_theta)
    for row in range(d.ripple.shape[0]):
        torque += d.ripple[row, 1] * math.sin(d.ripple[row, 0] * theta + d.ripple[row, 2])
    torque -= d.spring * (theta - d.spring_theta)
    if gripped(d, t):
        torque -= d.hand_damping * omega + d.hand_stiffness * (theta - d.hand_theta)
    if d.coloured.size > 1:
        torque += torque_from_outside(d, t)
    return torque


@njit(cache=True)
def joint(d, twist, twist_rate):
    """Torque that the motor gives to the load: a spring and damper, or a stiff contact on either side of the play."""
    if d.backlash_half == 0.0:
        return d.joint_stiffness * twist + d.joint_damping * twist_rate
    if twist > d.backlash_half:
        return max(0.0, d.joint_stiffness * (twist - d.backlash_half) + d.joint_damping * twist_rate)
    if twist < -d.backlash_half:
        return min(0.0, d.joint_stiffness * (twist + d.backlash_half) + d.joint_damping * twist_rate)
    return 0.0


@njit(cache=True)
def accelerations(d, t, theta, omega, z, load_theta, load_omega, current, direction):
    """Of motor and load, sliding in a direction (+1, −1), or held by stiction (0, without a bristle)."""
    inertia = d.inertia * (1.0 - d.load_share)
    if gripped(d, t):
        inertia += d.hand_inertia
    coupling = joint(d, theta - load_theta, omega - load_omega) if d.load_share > 0.0 else 0.0
    load = coupling / (d.inertia * d.load_share) if d.load_share > 0.0 else 0.0
    level = coulomb_level(d, t, omega, current)
    push = drive(d, t, theta, omega, current) - coupling
    if d.bristle_breakaway > 0.0:
        z_rate = omega - d.bristle_stiffness * abs(omega) * z / level
        return (push - d.bristle_stiffness * z - d.bristle_damping * z_rate) / inertia, load
    if direction == 0.0:
        return 0.0, load
    return (push - level * direction) / inertia, load


@njit(cache=True)
def bristle_after(d, t, z, omega, current, h):
    """Bristle deflection after h at constant ω: exact, so that no speed makes it stiff."""
    if d.bristle_breakaway == 0.0 or omega == 0.0:
        return z
    limit = coulomb_level(d, t, omega, current) / d.bristle_stiffness
    settled = limit if omega > 0.0 else -limit
    return settled + (z - settled) * math.exp(-abs(omega) * h / limit)


@njit(cache=True)
def sliding_direction(d, t, s, current):
    """The sign of friction from the state: of ω, or at rest of the torque where it exceeds stiction, else 0."""
    if s[OMEGA] != 0.0:
        return 1.0 if s[OMEGA] > 0.0 else -1.0
    push = drive(d, t, s[THETA], 0.0, current)
    if d.load_share > 0.0:
        push -= joint(d, s[THETA] - s[LOAD_THETA], -s[LOAD_OMEGA])
    if abs(push) <= coulomb_level(d, t, 0.0, current):
        return 0.0
    return 1.0 if push > 0.0 else -1.0


@njit(cache=True)
def mechanical_step(d, t, h, s, current):
    """Motor, load and bristle over h at a given current; a change of sign of ω inside h is located by interpolation."""
    end = t + h
    for _ in range(6):
        h = end - t
        theta, omega, load_theta, load_omega = s[THETA], s[OMEGA], s[LOAD_THETA], s[LOAD_OMEGA]
        direction = sliding_direction(d, t, s, current)
        a, load_a = accelerations(d, t, theta, omega, s[BRISTLE], load_theta, load_omega, current, direction)
        half = 0.5 * h
        mid_omega, mid_load = omega + half * a, load_omega + half * load_a
        mid_z = bristle_after(d, t, s[BRISTLE], omega, current, half)
        a, load_a = accelerations(
            d, t + half, theta + half * omega, mid_omega, mid_z, load_theta + half * load_omega, mid_load, current, direction
        )  # fmt: skip
        new_omega = omega + h * a
        crossed = d.bristle_breakaway == 0.0 and new_omega * direction < 0.0
        share = 1.0
        if crossed:
            share = omega / (omega - new_omega)
            s[THETA] = theta + 0.5 * share * h * omega
            s[OMEGA] = 0.0
        else:
            s[THETA] = theta + h * mid_omega
            s[OMEGA] = new_omega
        s[BRISTLE] = bristle_after(d, t + half, s[BRISTLE], mid_omega, current, h)
        s[LOAD_THETA] = load_theta + share * h * mid_load
        s[LOAD_OMEGA] = load_omega + share * h * load_a
        if not crossed:
            return
        t += share * h


@njit(cache=True)
def advance(d, s, t, end, command, step):
    """Move the device from t to end at one delivered command (A), through the amplifier's lag."""
    count = max(1, math.ceil((end - t) / step - 1e-9))
    h = (end - t) / count
    for number in range(count):
        current = command
        if d.lag_omega > 0.0:
            i, rate = s[CURRENT], s[CURRENT_RATE]
            half = 0.5 * h
            bend = d.lag_omega**2 * (command - i) - 2.0 * d.lag_damping * d.lag_omega * rate
            current, mid_rate = i + half * rate, rate + half * bend
            bend = d.lag_omega**2 * (command - current) - 2.0 * d.lag_damping * d.lag_omega * mid_rate
            s[CURRENT], s[CURRENT_RATE] = i + h * mid_rate, rate + h * bend
        else:
            s[CURRENT] = command
        mechanical_step(d, t + number * h, h, s, current)


@njit(cache=True)
def interval(d, s, times, delivered, k, due, step):
    """From tick k to the next; ``due`` is the next command that has yet to arrive, and is returned."""
    t, end = times[k], times[k + 1]
    while t < end:
        while due <= k and times[due] + d.delay_s <= t:
            due += 1
        stop = end if due > k else min(end, times[due] + d.delay_s)
        advance(d, s, t, stop, delivered[due - 1] if due > 0 else 0.0, step)
        t = stop
    return due


@njit(cache=True)
def measured(d, theta):
    """What the encoder's disc shows at a shaft angle."""
    shown = theta
    if d.eccentricity != 0.0:
        shown += d.eccentricity * math.sin(theta + d.eccentricity_phase)
    if d.eccentricity_2 != 0.0:
        shown += d.eccentricity_2 * math.sin(2.0 * theta + d.eccentricity_2_phase)
    return shown


@njit(cache=True)
def delivered_current(d, command):
    """A command after the converter and the limit that the effects put into its way."""
    if d.dac_step > 0.0:
        command = d.dac_step * np.rint(command / d.dac_step)
    return min(max(command, -d.current_limit), d.current_limit)


@njit(cache=True)
def run(d, loop, times, extra, origin, lost, noise, start, step):
    """Closed loop over all ticks.

    Args:
        d: the device.
        loop: the virtual spring.
        times: instants of the samples, s, shape (n,).
        extra: excitation current, A, shape (n,).
        origin: displacement of the spring's origin, raw counts, shape (n,).
        lost: whether a tick's command is lost, shape (n,).
        noise: added to the measured position before it is floored, rad, shape (n,).
        start: the state at times[0], shape (STATE_WORDS,).
        step: longest integration step, s.

    Returns:
        Counts, recorded commands (A), commands on their way to the motor (A), states at the ticks, and the number of
        ticks done: fewer than n when a limit of the loop was passed.
    """
    n = times.size
    counts = np.zeros(n, np.int64)
    commanded, delivered = np.zeros(n), np.zeros(n)
    states = np.zeros((n, STATE_WORDS))
    s = start.copy()
    due = 0
    for k in range(n):
        states[k] = s
        if abs(s[OMEGA]) > loop.max_omega or abs(s[THETA]) > loop.max_theta:
            return counts, commanded, delivered, states, k
        counts[k] = math.floor((measured(d, s[THETA]) + noise[k]) / d.resolution)
        ticks = math.floor((counts[k] - origin[k]) / loop.decimation)
        force = -loop.stiffness * loop.decimation * d.resolution * (ticks + 0.5)
        command = force / loop.torque_constant + extra[k]
        command = min(max(command, -loop.peak_current), loop.peak_current)
        if loop.dac_step > 0.0:
            command = loop.dac_step * np.rint(command / loop.dac_step)
        commanded[k] = command
        if lost[k]:
            delivered[k] = delivered[k - 1] if k > 0 else 0.0
        else:
            delivered[k] = delivered_current(d, command)
        if k + 1 < n:
            due = interval(d, s, times, delivered, k, due, step)
    return counts, commanded, delivered, states, n


@njit(cache=True)
def replay(d, times, commanded, starts, first, length, step):
    """Open loop over windows, from given states, at the recorded commands.

    Args:
        d: the device.
        times: instants of the samples, s, shape (n,).
        commanded: recorded commands, A, shape (n,).
        starts: state at the first tick of each window, shape (w, STATE_WORDS).
        first: the number of that tick, shape (w,).
        length: ticks in a window.
        step: longest integration step, s.

    Returns:
        Shown positions, rad, shape (w, length), the first at the start.
    """
    found = np.zeros((first.size, length))
    delivered = np.empty(commanded.size)
    for k in range(commanded.size):
        delivered[k] = delivered_current(d, commanded[k])
    for w in range(first.size):
        s = starts[w].copy()
        due = 0
        while due < times.size and times[due] + d.delay_s <= times[first[w]]:
            due += 1
        for k in range(length):
            found[w, k] = measured(d, s[THETA])
            if k + 1 < length:
                due = interval(d, s, times, delivered, first[w] + k, due, step)
    return found
