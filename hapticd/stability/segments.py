"""Exact motion with the energy dissipated by friction, under a constant applied force.

Between two force steps the motion of :mod:`hapticd.plant.exact` has at most two parts, each in one direction
only. In each, with v′ = g − rv, r = b/m, z = −rt,

    ∫v² dt = t(v²φ₁(2z) + gt(vφ₁(z)² + gtψ(z))),      ψ(z) = ∫₀¹ u²φ₁(zu)² du = (½φ₁(z)² − φ₂(z))/z,

and ∫|v| dt is the distance. So the energies of viscous friction (b∫v²) and Coulomb friction (c∫|v|), eq. 28 and 36, have no
integration error.

With a hand's stiffness each part is a damped oscillation; b∫v² then follows from the work done in it.
All functions work in any consistent units: SI, or ticks and periods with (m, b, c) = (μ, β, σ).
"""

from __future__ import annotations

import math

from numba import types

from hapticd.jit import njit
from hapticd.plant.exact import glide, phi_functions
from hapticd.plant.spring import spring_functions, time_to_rest

_f8 = types.float64

# Below this |z| the closed form of ψ subtracts nearly equal numbers.
_SERIES_ABOVE = -0.5
# (2ᵏ⁺² − 2)/((k + 2)!(k + 3)): ψ(z) = Σ of these times zᵏ
_PSI = tuple((2.0 ** (k + 2) - 2.0) / (math.factorial(k + 2) * (k + 3)) for k in range(17))


@njit(_f8(_f8, _f8, _f8))
def _psi(z: float, phi1: float, phi2: float) -> float:
    if z < _SERIES_ABOVE:
        return (0.5 * phi1 * phi1 - phi2) / z
    total = 0.0
    for k in range(len(_PSI) - 1, -1, -1):
        total = _PSI[k] + z * total
    return total


@njit(types.UniTuple(_f8, 4)(_f8, _f8, _f8, _f8))
def glide_with_square(speed: float, dt: float, g: float, rate: float) -> tuple[float, float, float, float]:
    """Distance, final speed, ∫v² dt and duration of v′ = g − rate·v, to the first stop or to the end of `dt`."""
    exponential, phi1, phi2 = phi_functions(-rate * dt)
    distance, end, time = glide(speed, g, rate, dt, exponential, phi1, phi2)
    if time < dt:
        exponential, phi1, phi2 = phi_functions(-rate * time)
    gained = g * time
    square = time * (
        speed * speed * (0.5 * phi1 * (1.0 + exponential))
        + gained * (speed * phi1 * phi1 + gained * _psi(-rate * time, phi1, phi2))
    )
    return distance, end, square, time


@njit(types.UniTuple(_f8, 6)(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8))
def move(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float, stiffness: float
) -> tuple[float, float, float, float, float, float]:
    """The motion of :func:`hapticd.plant.spring.propagate_with_stiffness`, with the energies of friction.

    Args:
        x: position. v: velocity. dt: duration, ≥ 0. force: constant, friction not included.
        inertia: > 0. viscous: ≥ 0. coulomb: ≥ 0, also the stiction. stiffness: of a spring with its rest at x = 0, ≥ 0.

    Returns:
        Position and velocity after `dt`; b∫v² dt (eq. 36), never negative, with a stiffness accurate to rounding of the
        energies exchanged; the distance ∫|v| dt, for the energy c∫|v| dt of Coulomb friction; the lowest and the
        highest position.
    """
    square, drag, path = 0.0, 0.0, 0.0
    low, high = x, x
    while True:
        pull = force - stiffness * x
        if v != 0.0:
            sign = math.copysign(1.0, v)
        elif abs(pull) <= coulomb:
            break
        else:
            sign = math.copysign(1.0, pull)
        speed, net = abs(v), sign * pull - coulomb
        if stiffness == 0.0:
            distance, end, more, time = glide_with_square(speed, dt, net / inertia, viscous / inertia)
            last = not time < dt
            square += more
        else:
            alpha, omega2 = 0.5 * viscous / inertia, stiffness / inertia
            time = time_to_rest(speed, net / inertia, alpha, omega2)
            last = not time < dt
            rate, s, p = spring_functions(dt if last else time, alpha, omega2)
            distance = speed * s + net / inertia * p
            end = speed * rate + net / inertia * s if last else 0.0
            drag += max(
                0.0, distance * (net - 0.5 * stiffness * distance) + 0.5 * inertia * (speed - end) * (speed + end)
            )
        x += sign * distance
        v = sign * end
        path += distance
        low, high = min(low, x), max(high, x)
        # The second condition: a half period below the resolution of the time.
        if last or (dt - time == dt and speed == 0.0):
            break
        dt -= time
    return x, v, drag + viscous * square, path, low, high
