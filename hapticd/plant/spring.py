"""Exact motion of a mass with friction, a constant force and a linear spring: an operator's grip (Sec. III-B).

Solves m·dv/dt + b·v + k·x + c·sgn(v) = F, dx/dt = v. While the velocity keeps its sign the displacement d from the
start obeys d″ + 2α·d′ + ω²·d = a, a = (F − c·sgn v − k·x)/m, 2α = b/m, ω² = k/m, so that

    d = v·S + a·P,      d′ = v·S′ + a·S,      S″ + 2α·S′ + ω²·S = 0, S(0) = 0, S′(0) = 1,      P = ∫ S.

S and P are written so that no digits cancel for any damping, nor for b → 0, k → 0 and critical damping. The
velocity's next zero is an arctangent or a logarithm; there the mass sticks (|F − k·x| ≤ c) or reverses. In a long
oscillation only the last half periods are computed one by one: before them the amplitude is a geometric series.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from hapticd.jit import njit
from hapticd.plant.exact import phi_functions, propagate, time_and_distance_to_rest

_f8 = types.float64
_SERIES_TERMS = 17
_INVERSE_FACTORIALS = tuple(1.0 / math.factorial(n) for n in range(_SERIES_TERMS + 2))
_NEGLIGIBLE = 1e-19
_LONG_SWING = 100.0


@njit(types.UniTuple(_f8, 3)(_f8, _f8, _f8))
def spring_functions(t: float, alpha: float, omega2: float) -> tuple[float, float, float]:
    """Return (S′, S, P) at time `t` for decay rate `alpha` ≥ 0 [1/s] and squared natural frequency `omega2` > 0."""
    a = alpha * t
    w2 = omega2 * t * t
    if a < 0.5 and w2 < 0.15:
        # Taylor series in t: here 1 − S′ − 2α·S, which P needs below, would cancel. `term` is that of n!·S⁽ⁿ⁾(0)·tⁿ.
        before, term = 0.0, 1.0
        rate = s = p = 0.0
        for n in range(_SERIES_TERMS):
            part = term * _INVERSE_FACTORIALS[n]
            rate += part
            s += term * _INVERSE_FACTORIALS[n + 1]
            p += term * _INVERSE_FACTORIALS[n + 2]
            if abs(part) < _NEGLIGIBLE and abs(before) * _INVERSE_FACTORIALS[n] < _NEGLIGIBLE:
                break
            before, term = term, -2.0 * a * term - w2 * before
        return rate, s * t, p * t * t
    kappa2 = (alpha - math.sqrt(omega2)) * (alpha + math.sqrt(omega2))
    if kappa2 < 0.0:
        omega_d = math.sqrt(-kappa2)
        decay = math.exp(-a)
        s = decay * math.sin(omega_d * t) / omega_d
        rate = decay * math.cos(omega_d * t) - alpha * s
        return rate, s, (1.0 - rate - 2.0 * alpha * s) / omega2
    kappa = math.sqrt(kappa2)
    fast = alpha + kappa
    slow = omega2 / fast
    _, difference, _ = phi_functions(-2.0 * kappa * t)
    s = math.exp(-slow * t) * t * difference
    rate = math.exp(-fast * t) - slow * s
    if 2.0 * kappa * t <= 0.5:
        return rate, s, (1.0 - rate - 2.0 * alpha * s) / omega2
    # Far from critical damping ω·t may be tiny: the difference of two φ₁ is then accurate, the form above is not.
    _, phi_slow, _ = phi_functions(-slow * t)
    _, phi_fast, _ = phi_functions(-fast * t)
    return rate, s, t * (phi_slow - phi_fast) / (2.0 * kappa)


@njit(_f8(_f8, _f8, _f8, _f8))
def time_to_rest(speed: float, a: float, alpha: float, omega2: float) -> float:
    """Time until speed·S′ + a·S, positive just after the start, is zero; infinite if it never is."""
    kappa2 = (alpha - math.sqrt(omega2)) * (alpha + math.sqrt(omega2))
    if kappa2 < 0.0:
        omega_d = math.sqrt(-kappa2)
        return math.atan2(speed * omega_d, alpha * speed - a) / omega_d
    kappa = math.sqrt(kappa2)
    braking = omega2 / (alpha + kappa) * speed - a
    if speed == 0.0 or braking <= 0.0:
        return math.inf
    return time_and_distance_to_rest(speed, braking, 2.0 * kappa)[0]


@njit(types.UniTuple(_f8, 2)(_f8, _f8, _f8, _f8, _f8))
def _swings_at_once(
    amplitude: float, band: float, alpha: float, omega2: float, remaining: float
) -> tuple[float, float]:
    """Advance by an even number of half oscillations from rest, except the last few before stiction or the end of the time.

    A half oscillation changes an amplitude e to q·e − d·(1 + q), with q = exp(−απ/ω_d) and the band of stiction d = c/k, in
    which the mass sticks.

    Returns:
        Decrease of the amplitude, and remaining time, which is not needed after the mass has stuck.
    """
    kappa2 = (alpha - math.sqrt(omega2)) * (alpha + math.sqrt(omega2))
    if kappa2 >= 0.0:
        return 0.0, remaining
    half = math.pi / math.sqrt(-kappa2)
    loss = alpha * half
    q, one, _ = phi_functions(-loss)
    until_stiction, _ = time_and_distance_to_rest((amplitude - band) * one, 2.0 * band, loss)
    remaining = min(remaining, (until_stiction + 2.0) * half)
    swings = 2.0 * np.floor(0.5 * min(until_stiction, remaining / half)) - 2.0
    if not swings >= 2.0:
        return 0.0, remaining
    _, many, _ = phi_functions(-loss * swings)
    return swings * many * (amplitude * loss + band * (1.0 + q) / one), max(remaining - swings * half, 0.0)


@njit(types.UniTuple(_f8, 2)(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8))
def propagate_with_stiffness(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float, stiffness: float
) -> tuple[float, float]:
    """Move the mass exactly through a time `dt` of constant force and a spring −stiffness·x, all stops included.

    Args:
        x: position from the spring's rest position [rad or m].
        v: velocity [rad/s or m/s].
        dt: duration [s], ≥ 0.
        force: constant applied torque or force [N m or N].
        inertia: inertia or mass [kg m² or kg], > 0.
        viscous: viscous friction [N m s/rad or N s/m], ≥ 0.
        coulomb: Coulomb friction [N m or N], ≥ 0; a mass at rest stays while |force − stiffness·x| ≤ coulomb.
        stiffness: spring stiffness [N m/rad or N/m], ≥ 0; at 0 this is `propagate`.

    Returns:
        Position and velocity after `dt`.
    """
    if stiffness == 0.0:
        return propagate(x, v, dt, force, inertia, viscous, coulomb)
    alpha = 0.5 * viscous / inertia
    omega2 = stiffness / inertia
    remaining = dt
    while True:
        pull = force - stiffness * x
        if v != 0.0:
            sign = math.copysign(1.0, v)
        elif abs(pull) <= coulomb:
            return x, 0.0
        else:
            sign = math.copysign(1.0, pull)
            if coulomb > 0.0 and remaining * math.sqrt(omega2) > _LONG_SWING:
                amplitude, band = abs(pull) / stiffness, coulomb / stiffness
                fall, remaining = _swings_at_once(amplitude, band, alpha, omega2, remaining)
                x += sign * fall
                pull = force - stiffness * x
                if abs(pull) <= coulomb:
                    return x, 0.0
                sign = math.copysign(1.0, pull)
        speed = abs(v)
        a = (sign * pull - coulomb) / inertia
        # Without Coulomb friction the equation of motion is the same after a reversal: no stop there.
        rest = time_to_rest(speed, a, alpha, omega2) if coulomb > 0.0 else math.inf
        if not rest < remaining:
            rate, s, p = spring_functions(remaining, alpha, omega2)
            return x + sign * (speed * s + a * p), sign * (speed * rate + a * s)
        _, s, p = spring_functions(rest, alpha, omega2)
        x += sign * (speed * s + a * p)
        v = 0.0
        remaining -= rest


@njit(types.UniTuple(_f8, 2)(_f8, _f8, _f8, _f8))
def springs_together(stiffness: float, rest: float, more: float, more_rest: float) -> tuple[float, float]:
    """Return stiffness and rest position of two springs in parallel; `more` > 0 is the second one's stiffness."""
    total = stiffness + more
    return total, (stiffness * rest + more * more_rest) / total


@njit(types.UniTuple(_f8, 2)(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8), inline=True)
def propagate_about_rest(
    x: float,
    v: float,
    dt: float,
    force: float,
    inertia: float,
    viscous: float,
    coulomb: float,
    stiffness: float,
    rest: float,
) -> tuple[float, float]:
    """`propagate_with_stiffness` for a spring with its rest position at `rest`, or for none."""
    if stiffness == 0.0:
        return propagate(x, v, dt, force, inertia, viscous, coulomb)
    before = x - rest
    after, v = propagate_with_stiffness(before, v, dt, force, inertia, viscous, coulomb, stiffness)
    # A shaft held by stiction keeps its position exactly, because it may be at an encoder edge.
    return after + rest if after != before else x, v
