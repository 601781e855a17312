"""Exact motion with its energies: what friction takes out while the applied force is constant.

Between two force steps the motion of :mod:`hapticd.plant.exact` falls into at most two pieces in which it goes one way
only. On each, with v′ = g − rv, r = b/m, z = −rt,

    ∫v² dt = t(v²φ₁(2z) + gt(vφ₁(z)² + gtψ(z))),      ψ(z) = ∫₀¹ u²φ₁(zu)² du = (½φ₁(z)² − φ₂(z))/z,

∫|v| dt is the way, and the time at which an encoder tick is crossed is the one root of a monotone function. So the
energies of viscous friction (b∫v²) and Coulomb friction (c∫|v|), eq. 28 and 36, carry no integration error.

A hand's stiffness makes the pieces pieces of a damped oscillation; b∫v² then follows from the work done on each piece.
All functions work in any consistent units: SI, or ticks and periods with (m, b, c) = (μ, β, σ).
"""

from __future__ import annotations

import math

from numba import types

from hapticd.jit import njit
from hapticd.plant.exact import phi_functions, time_and_way_to_rest
from hapticd.plant.spring import spring_functions, time_to_rest

_f8 = types.float64

# Below this |z| the closed form of ψ subtracts nearly equal numbers.
_SERIES_ABOVE = -0.125
# (2ᵏ⁺² − 2)/((k + 2)!(k + 3)): ψ(z) = Σ of these times zᵏ
_PSI = tuple((2.0 ** (k + 2) - 2.0) / (math.factorial(k + 2) * (k + 3)) for k in range(12))
_MAX_STEPS = 200


@njit(_f8(_f8, _f8, _f8))
def _psi(z: float, phi1: float, phi2: float) -> float:
    if z < _SERIES_ABOVE:
        return (0.5 * phi1 * phi1 - phi2) / z
    total = 0.0
    for k in range(len(_PSI) - 1, -1, -1):
        total = _PSI[k] + z * total
    return total


@njit(types.UniTuple(_f8, 3)(_f8, _f8, _f8, _f8))
def way_speed_square(v: float, dt: float, g: float, rate: float) -> tuple[float, float, float]:
    """Way, end velocity and ∫v² dt of v′ = g − rate·v over `dt`, friction not switched on the way."""
    z = -rate * dt
    exponential, phi1, phi2 = phi_functions(z)
    gained = g * dt
    way = dt * (v * phi1 + gained * phi2)
    square = dt * (
        v * v * (0.5 * phi1 * (1.0 + exponential)) + gained * (v * phi1 * phi1 + gained * _psi(z, phi1, phi2))
    )
    return way, v * exponential + gained * phi1, square


@njit(types.UniTuple(_f8, 6)(_f8, _f8, _f8, _f8, _f8, _f8, _f8))
def move(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float
) -> tuple[float, float, float, float, float, float]:
    """Move exactly under a constant force, as :func:`hapticd.plant.exact.propagate` does, and account for friction.

    Args:
        x: position. v: velocity. dt: duration, ≥ 0. force: constant, friction not included.
        inertia: > 0. viscous: ≥ 0. coulomb: ≥ 0, also the stiction.

    Returns:
        Position and velocity after `dt`; b∫v² dt (eq. 36); the way ∫|v| dt, of which Coulomb friction takes c times
        the length; the lowest and the highest position on the way.
    """
    rate = viscous / inertia
    path, square = 0.0, 0.0
    low, high = x, x
    if v != 0.0:
        sign = math.copysign(1.0, v)
        speed = abs(v)
        net = sign * force - coulomb
        way, end, square = way_speed_square(speed, dt, net / inertia, rate)
        if net >= 0.0 or not end <= 0.0:
            x += sign * way
            return x, sign * end, viscous * square, way, min(low, x), max(high, x)
        time, way = time_and_way_to_rest(speed, -net / inertia, rate)
        time = min(time, dt)
        _, _, square = way_speed_square(speed, time, net / inertia, rate)
        x += sign * way
        path = way
        low, high = min(low, x), max(high, x)
        dt -= time
    if abs(force) <= coulomb:
        return x, 0.0, viscous * square, path, low, high
    sign = math.copysign(1.0, force)
    way, end, more = way_speed_square(0.0, dt, (abs(force) - coulomb) / inertia, rate)
    x += sign * way
    return x, sign * end, viscous * (square + more), path + way, min(low, x), max(high, x)


@njit(types.UniTuple(_f8, 6)(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8))
def move_with_stiffness(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float, stiffness: float
) -> tuple[float, float, float, float, float, float]:
    """`move` with a hand's spring −stiffness·x added; b∫v² from the work done on each piece between two stops.

    Returns:
        As `move`; b∫v² is good to rounding of the energies that are exchanged, and never negative.
    """
    if stiffness == 0.0:
        return move(x, v, dt, force, inertia, viscous, coulomb)
    alpha, omega2 = 0.5 * viscous / inertia, stiffness / inertia
    drag, path = 0.0, 0.0
    low, high = x, x
    while True:
        pull = force - stiffness * x
        if v != 0.0:
            sign = math.copysign(1.0, v)
        elif abs(pull) <= coulomb:
            return x, 0.0, drag, path, low, high
        else:
            sign = math.copysign(1.0, pull)
        speed = abs(v)
        net = sign * pull - coulomb
        rest = time_to_rest(speed, net / inertia, alpha, omega2)
        last = not rest < dt
        rate, s, p = spring_functions(dt if last else rest, alpha, omega2)
        way = speed * s + net / inertia * p
        end = speed * rate + net / inertia * s if last else 0.0
        drag += max(0.0, way * (net - 0.5 * stiffness * way) + 0.5 * inertia * (speed - end) * (speed + end))
        x += sign * way
        path += way
        low, high = min(low, x), max(high, x)
        v = sign * end
        # The second: a half period too short to move the clock.
        if last or (dt - rest == dt and speed == 0.0):
            return x, v, drag, path, low, high
        dt -= rest


@njit(_f8(_f8, _f8, _f8, _f8, _f8))
def crossing_time(distance: float, speed: float, g: float, rate: float, dt: float) -> float:
    """When a way is covered by v′ = g − rate·v, from `speed` ≥ 0, moving forwards all through `dt`.

    Args:
        distance: the way, ≥ 0. speed: at the start. g: net acceleration. rate: b/m. dt: longest time.

    Returns:
        The time, to the last bits; `dt` if the way is not covered by then.
    """
    low, high = 0.0, dt
    if distance <= 0.0:
        return 0.0
    covered, v, _ = way_speed_square(speed, dt, g, rate)
    if covered <= distance:
        return dt
    time = dt * distance / covered
    for _ in range(_MAX_STEPS):
        covered, v, _ = way_speed_square(speed, time, g, rate)
        error = covered - distance
        if error < 0.0:
            low = time
        else:
            high = time
        following = time - error / v if v > 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        if following == time or not low < following < high:
            break
        time = following
    return time


def tick_crossings(
    xi: float, xi_dot: float, dt: float, force: float, mu: float, beta: float, sigma: float
) -> list[tuple[float, int]]:
    """When an encoder edge is crossed while the force is constant.

    Args:
        xi: position in ticks. xi_dot: velocity in ticks per period. dt: duration in periods. force: in ticks' force.
        mu: inertia. beta: viscous friction. sigma: Coulomb friction.

    Returns:
        (time, new reading ⌊ξ⌋) in time order.
    """
    crossings: list[tuple[float, int]] = []
    start, position, velocity, left = 0.0, xi, xi_dot, dt
    while left > 0.0 and (velocity != 0.0 or abs(force) > sigma):
        sign = math.copysign(1.0, velocity if velocity != 0.0 else force)
        speed, net, rate = abs(velocity), (sign * force - sigma) / mu, beta / mu
        way, end, _ = way_speed_square(speed, left, net, rate)
        length = left
        if net < 0.0 and end <= 0.0:
            length, way = time_and_way_to_rest(speed, -net, rate)
            length, end = min(length, left), 0.0
        for edge, reading in _edges(position, position + sign * way):
            crossings.append((start + crossing_time(abs(edge - position), speed, net, rate, length), reading))
        position, velocity = position + sign * way, sign * end
        start, left = start + length, left - length
    return crossings


def _edges(start: float, end: float) -> list[tuple[int, int]]:
    """Encoder edges between two positions in the order of the motion, each with the reading beyond it."""
    if end >= start:
        return [(n, n) for n in range(math.floor(start) + 1, math.floor(end) + 1)]
    return [(n, n - 1) for n in range(math.floor(start), math.floor(end), -1)]
