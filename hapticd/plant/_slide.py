"""One phase of the shaft's motion with the effect terms: to its next stop, or to the end of a step.

Within a phase the direction does not change. Terms that vary with position or speed are taken as their mean over the path
and at the mean speed of the phase, by prediction and correction (second order in the step); the rest, constant
force, viscous friction and springs, is in closed form, so that the instant of a stop does not depend on the step size.
With constant terms a phase is exact.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from numba import types

from hapticd.jit import njit
from hapticd.plant.effect_terms import damping_at, field_torque, friction_level, has_smooth_terms, steady_span
from hapticd.plant.exact import glide, phi_functions
from hapticd.plant.spring import spring_functions, time_to_rest

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Forces(NamedTuple):
    """Forces on the shaft during one step, without the effect terms that change within it; SI units, rotary or linear."""

    drive: float
    """Sum of all constant torques."""
    motor: float
    """The motor's torque, a part of it."""
    current: float
    """The motor's current [A]."""
    inertia: float
    """Moving inertia."""
    viscous: float
    """Viscous friction of the device."""
    damping: float
    """Viscous friction of hands."""
    stiffness: float
    """Sum of all springs."""
    rest: float
    """Rest position of their sum."""
    warm: float
    """Factor on the Coulomb friction."""
    time: float
    """The plant's time at the middle of the step [s]."""


_f8 = types.float64
_p = types.Array(_f8, 1, "C")
_HALF_SWING = 9.0
"""Squared phase of an undamped half oscillation, less than π²."""
FORCES = types.NamedUniTuple(_f8, 10, Forces)
"""Numba type of `Forces`."""


@njit(_f8(_p, _f8, _f8, _f8, FORCES), counted=False, inline=True)
def pull_on(p: NDArray[Any], x: float, end: float, velocity: float, on: Forces) -> float:
    """Return the sum of all torques but friction at `x`; those of the effect terms are means over the path to `end`.

    Springs are taken at `x`; `velocity` is the mean on the path.
    """
    return on.drive + field_torque(p, x, end, velocity, on.time, on.current) - on.stiffness * (x - on.rest)


@njit(_f8(_p, _f8, FORCES), counted=False, inline=True)
def friction_of(p: NDArray[Any], speed: float, on: Forces) -> float:
    """Return the Coulomb friction at a speed ≥ 0; at 0 stiction."""
    return friction_level(p, speed, on.motor, on.warm, on.time)


@njit(types.UniTuple(_f8, 3)(_f8, _f8, _f8, _f8, _f8))
def glide_on_spring(speed: float, a: float, span: float, rate: float, omega2: float) -> tuple[float, float, float]:
    """Move in one direction by speed′ = a − rate·speed − omega2·distance, until the speed is zero or `span` is over.

    Args:
        speed: initial speed, ≥ 0.
        a: initial acceleration without the viscous part.
        span: duration [s].
        rate: b/m ≥ 0 [1/s].
        omega2: k/m ≥ 0 [1/s²].

    Returns:
        Distance ≥ 0, final speed ≥ 0 and duration; all zero for a mass at rest without a forward force.
    """
    if speed == 0.0 and not a > 0.0:
        return 0.0, 0.0, 0.0
    if omega2 == 0.0:
        exponential, phi1, phi2 = phi_functions(-rate * span)
        return glide(speed, a, rate, span, exponential, phi1, phi2)
    end_rate, s, p = spring_functions(span, 0.5 * rate, omega2)
    end = speed * end_rate + a * s
    # Zeros of the speed are half an oscillation apart: in less time a positive final speed means no stop.
    if end > 0.0 and omega2 * span * span < _HALF_SWING:
        return speed * s + a * p, end, span
    time = time_to_rest(speed, a, 0.5 * rate, omega2)
    if time < span:
        _, s, p = spring_functions(time, 0.5 * rate, omega2)
        return max(speed * s + a * p, 0.0), 0.0, time
    return speed * s + a * p, max(end, 0.0), span


@njit(types.UniTuple(_f8, 3)(_p, _f8, _f8, _f8, FORCES), counted=False)
def slide(p: NDArray[Any], x: float, v: float, span: float, on: Forces) -> tuple[float, float, float]:
    """Move the shaft with stiction through one phase.

    Args:
        p: device vector.
        x: position [rad or m].
        v: velocity [rad/s or m/s].
        span: longest duration [s].
        on: forces on the shaft.

    Returns:
        Position, velocity and duration: `span`, or less if the shaft stops before, or friction changes fast.
    """
    if v == 0.0:
        pull = pull_on(p, x, x, 0.0, on)
        if abs(pull) <= friction_of(p, 0.0, on):
            return x, 0.0, span
        sign = math.copysign(1.0, pull)
    else:
        sign = math.copysign(1.0, v)
    speed = abs(v)
    distance, end, time = 0.0, speed, span
    is_exact = not has_smooth_terms(p)
    for attempt in range(3):
        mean_speed = 0.5 * (speed + end)
        level, total = damping_at(p, mean_speed, sign, friction_of(p, mean_speed, on), on.viscous)
        pull = pull_on(p, x, x + sign * distance, sign * mean_speed, on)
        if attempt == 0:
            span = steady_span(p, speed, sign * pull, on.inertia, span)
        distance, end, time = glide_on_spring(
            speed,
            (sign * pull - level) / on.inertia,
            span,
            (total + on.damping) / on.inertia,
            on.stiffness / on.inertia,
        )
        # A stop shortens the path over which the terms are averaged: repeat.
        if is_exact or (attempt == 1 and time == span):
            break
    if time == 0.0 and v == 0.0:
        return x, 0.0, span
    return x + sign * distance, sign * end if end > 0.0 else 0.0, time
