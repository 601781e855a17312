"""One phase of the shaft's motion under the effect terms: from where it is to its next stop, or to the end of a step.

Within a phase the direction does not change. Terms that vary with position or speed are taken as their mean over the way
and at the mean speed of the phase, found by prediction and correction (second order in the step); what remains, constant
force, viscous friction and springs, is in closed form, so that the instant of a stop is not a matter of the step size.
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
    """What acts on the shaft during one step, besides the effect terms that change within it; SI units, rotary or linear."""

    drive: float
    """All constant torques together."""
    motor: float
    """The motor's torque among them."""
    current: float
    """The motor's current [A]."""
    inertia: float
    """What moves."""
    viscous: float
    """Viscous friction of the device."""
    damping: float
    """Viscous friction of hands."""
    stiffness: float
    """All springs together."""
    rest: float
    """Position at which they are relaxed together."""
    warm: float
    """Factor on the Coulomb friction."""
    time: float
    """The plant's time at the middle of the step [s]."""


_f8 = types.float64
_p = types.Array(_f8, 1, "C")
_HALF_SWING = 9.0
"""Less than π²: squared phase of an undamped half swing."""
FORCES = types.NamedUniTuple(_f8, 10, Forces)
"""Numba type of `Forces`."""


@njit(_f8(_p, _f8, _f8, _f8, FORCES), counted=False, inline=True)
def pull_on(p: NDArray[Any], x: float, end: float, velocity: float, on: Forces) -> float:
    """Return the sum of all torques but friction at `x`; those of the effect terms are means over the way to `end`.

    Springs pull as they do at `x`; `velocity` is the mean one on the way.
    """
    return on.drive + field_torque(p, x, end, velocity, on.time, on.current) - on.stiffness * (x - on.rest)


@njit(_f8(_p, _f8, FORCES), counted=False, inline=True)
def friction_of(p: NDArray[Any], speed: float, on: Forces) -> float:
    """Return the Coulomb friction at a speed ≥ 0; at 0 stiction."""
    return friction_level(p, speed, on.motor, on.warm, on.time)


@njit(types.UniTuple(_f8, 3)(_f8, _f8, _f8, _f8, _f8))
def glide_on_spring(speed: float, a: float, span: float, rate: float, omega2: float) -> tuple[float, float, float]:
    """Move one way by speed′ = a − rate·speed − omega2·way, until the speed is zero or `span` is over.

    Args:
        speed: initial speed, ≥ 0.
        a: initial acceleration without the viscous part.
        span: duration [s].
        rate: b/m ≥ 0 [1/s].
        omega2: k/m ≥ 0 [1/s²].

    Returns:
        Way ≥ 0, final speed ≥ 0 and time taken; at once zero for a mass at rest that nothing moves forwards.
    """
    if speed == 0.0 and not a > 0.0:
        return 0.0, 0.0, 0.0
    if omega2 == 0.0:
        exponential, phi1, phi2 = phi_functions(-rate * span)
        return glide(speed, a, rate, span, exponential, phi1, phi2)
    end_rate, s, p = spring_functions(span, 0.5 * rate, omega2)
    end = speed * end_rate + a * s
    # Zeros of the speed are half a swing apart: in less than that a positive end means no stop on the way.
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
        on: what acts on the shaft.

    Returns:
        Position, velocity and time taken: `span`, or less when the shaft stops before, or friction changes fast.
    """
    if v == 0.0:
        pull = pull_on(p, x, x, 0.0, on)
        if abs(pull) <= friction_of(p, 0.0, on):
            return x, 0.0, span
        sign = math.copysign(1.0, pull)
    else:
        sign = math.copysign(1.0, v)
    speed = abs(v)
    way, end, time = 0.0, speed, span
    is_exact = not has_smooth_terms(p)
    for attempt in range(3):
        mean_speed = 0.5 * (speed + end)
        level, total = damping_at(p, mean_speed, sign, friction_of(p, mean_speed, on), on.viscous)
        pull = pull_on(p, x, x + sign * way, sign * mean_speed, on)
        if attempt == 0:
            span = steady_span(p, speed, sign * pull, on.inertia, span)
        way, end, time = glide_on_spring(
            speed,
            (sign * pull - level) / on.inertia,
            span,
            (total + on.damping) / on.inertia,
            on.stiffness / on.inertia,
        )
        # A stop shortens the way over which the terms are averaged: once more.
        if is_exact or (attempt == 1 and time == span):
            break
    if time == 0.0 and v == 0.0:
        return x, 0.0, span
    return x + sign * way, sign * end if end > 0.0 else 0.0, time
