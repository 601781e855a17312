"""Exact motion of a mass with viscous and Coulomb friction under a constant force.

Solves m·dv/dt + b·v + c·sgn(v) = F, dx/dt = v (eq. 1 of the paper; eq. 6 in its dimensionless form) over a time dt in
which F does not change, in closed form. While the velocity keeps its sign, with z = −b·dt/m and g = (F − c·sgn v)/m,

    v(dt) = v·eᶻ + g·dt·φ₁(z),      x(dt) = x + v·dt·φ₁(z) + g·dt²·φ₂(z),

    φ₁(z) = (eᶻ − 1)/z,             φ₂(z) = (eᶻ − 1 − z)/z².

Friction brings a decelerating mass to rest after m/b·log(1 + w), w = b·|v|/(c − F·sgn v); it then sticks (|F| ≤ c) or
reverses. There is no time step and no tolerance. All functions work in any consistent system of units: SI, or
the paper's ticks and periods with (inertia, viscous, coulomb) = (μ, β, σ).

The same motion with a linear spring added is in `hapticd.plant.spring`; see docs/explanation/exact-plant.md.
"""

from __future__ import annotations

import math

from numba import types

from hapticd.jit import njit

_f8 = types.float64

# Below this |z| (or w) the closed forms subtract nearly equal numbers and a short series is both exact and faster.
_SERIES_BELOW = 0.0625
_LOG_SERIES_BELOW = 0.125
_LARGEST = 1.7976931348623157e308


@njit(types.UniTuple(_f8, 3)(_f8))
def phi_functions(z: float) -> tuple[float, float, float]:
    """Return (eᶻ, φ₁(z), φ₂(z)) for z ≤ 0, each to a few units in the last place, z → 0 and z → −∞ included."""
    if z > -_SERIES_BELOW:
        # Σ zᵏ/(k+2)!, k = 0…8, summed in pairs: the latency of plain Horner would dominate a sampling period.
        z2 = z * z
        z4 = z2 * z2
        low = (1.0 / 2.0 + z * (1.0 / 6.0)) + z2 * (1.0 / 24.0 + z * (1.0 / 120.0))
        high = (1.0 / 720.0 + z * (1.0 / 5040.0)) + z2 * (1.0 / 40320.0 + z * (1.0 / 362880.0) + z2 * (1.0 / 3628800.0))
        phi2 = low + z4 * high
        phi1 = 1.0 + z * phi2
        return 1.0 + z * phi1, phi1, phi2
    if z > -1.0:
        grown = math.expm1(z)
        exponential = 1.0 + grown
    else:
        exponential = math.exp(z)
        grown = exponential - 1.0
    phi1 = grown / z
    return exponential, phi1, (phi1 - 1.0) / z


@njit(types.UniTuple(_f8, 2)(_f8, _f8, _f8))
def time_and_distance_to_rest(speed: float, deceleration: float, rate: float) -> tuple[float, float]:
    """Return time and distance in which v′ = −deceleration − rate·v brings a speed to zero.

    With w = rate·speed/deceleration the time is log(1+w)/rate and the distance speed/rate·(1 − log(1+w)/w).

    Args:
        speed: initial speed, > 0.
        deceleration: constant part of the deceleration, ≥ 0.
        rate: decay rate b/m, ≥ 0.
    """
    w = rate * speed / deceleration
    if w < _LOG_SERIES_BELOW:
        # log(1+w) = 2·artanh(s), s = w/(2+w); the first term of w − log(1+w) is then exact and no digits cancel.
        r = 1.0 / (2.0 + w)
        s = w * r
        q = s * s
        tail = 1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * (1.0 / 9.0 + q * (1.0 / 11.0 + q * (1.0 / 13.0)))))
        without_drag = speed / deceleration
        return 2.0 * r * (1.0 + q * tail) * without_drag, (r - 2.0 * r * r * s * tail) * speed * without_drag
    if not w < _LARGEST:
        # The deceleration is negligible: viscous friction alone stops the mass.
        w = _LARGEST
    logarithm = math.log1p(w)
    return logarithm / rate, speed / rate * (1.0 - logarithm / w)


@njit(types.UniTuple(_f8, 3)(_f8, _f8, _f8, _f8, _f8, _f8, _f8), inline=True)
def glide(
    v: float, g: float, rate: float, dt: float, exponential: float, phi1: float, phi2: float
) -> tuple[float, float, float]:
    """Move by v′ = g − rate·v to the first stop, or to the end of `dt`: the closed form of all motion.

    Args:
        v: initial velocity; zero for a mass that g ≥ 0 starts.
        g: acceleration by all constant forces, including Coulomb friction.
        rate: decay rate b/m, ≥ 0.
        dt: duration, ≥ 0.
        exponential: eᶻ of z = −rate·dt; phi1: φ₁(z); phi2: φ₂(z), from `phi_functions`.

    Returns:
        Displacement, final velocity and duration: at a stop zero velocity and at most `dt`, else `dt`. NaN propagates.
    """
    gained = g * dt
    end = v * exponential + gained * phi1
    direction = math.copysign(1.0, v)
    # Speed is monotone in time here, so a final speed in the same direction means no stop. NaN propagates.
    if not direction * end <= 0.0 or direction * g >= 0.0:
        return dt * (v * phi1 + gained * phi2), end, dt
    time, distance = time_and_distance_to_rest(abs(v), abs(g), rate)
    return direction * distance, 0.0, min(time, dt)


@njit(types.UniTuple(_f8, 2)(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8), inline=True)
def step(
    x: float,
    v: float,
    dt: float,
    force: float,
    inertia: float,
    viscous: float,
    coulomb: float,
    exponential: float,
    phi1: float,
    phi2: float,
) -> tuple[float, float]:
    """`propagate` for a constant `dt`, with given `phi_functions(-viscous * dt / inertia)`."""
    remaining = dt
    if v != 0.0:
        g = (force - math.copysign(coulomb, v)) / inertia
        distance, v, time = glide(v, g, viscous / inertia, dt, exponential, phi1, phi2)
        x += distance
        if v != 0.0:
            return x, v
        remaining -= time
    if abs(force) <= coulomb:
        return x, 0.0
    if remaining < dt:
        _, phi1, phi2 = phi_functions(-viscous * remaining / inertia)
    g = (force - math.copysign(coulomb, force)) / inertia
    return x + g * remaining * remaining * phi2, g * remaining * phi1


@njit(types.UniTuple(_f8, 2)(_f8, _f8, _f8, _f8, _f8, _f8, _f8))
def propagate(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float
) -> tuple[float, float]:
    """Move the mass exactly through a time `dt` of constant force (eq. 1, with stiction at v = 0).

    Args:
        x: position [rad or m].
        v: velocity [rad/s or m/s].
        dt: duration [s], ≥ 0.
        force: constant applied torque or force [N m or N], friction not included.
        inertia: inertia or mass [kg m² or kg], > 0.
        viscous: viscous friction [N m s/rad or N s/m], ≥ 0.
        coulomb: Coulomb friction [N m or N], ≥ 0; a mass at rest stays there while |force| ≤ coulomb.

    Returns:
        Position and velocity after `dt`, accurate to 1e-12 relative to max(|x|, |v|·dt). A NaN that the motion
        depends on propagates.
    """
    if v == 0.0 and abs(force) <= coulomb:
        return x, 0.0
    exponential, phi1, phi2 = phi_functions(-viscous * dt / inertia)
    return step(x, v, dt, force, inertia, viscous, coulomb, exponential, phi1, phi2)
