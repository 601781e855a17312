"""Exact motion of motor and load on a spring and a damper, phase by phase, for a device with stiction.

While the motor keeps its direction, its displacement y, its speed s, and the twist w and twist rate r of the load relative
to it obey

    s′ = a − b·s − k·y + μ·q,      r′ = −q − s′,      q = ω₀²·w + 2ζω₀·r,      y′ = s,  w′ = r,

with μ = J_L/J_M. Their Taylor series converges to rounding over a radian of the two masses' oscillation, the longest a
phase lasts. When the motor sticks the load oscillates on a fixed end. Terms that vary with position or speed are taken at
their mean over a phase, as in `hapticd.plant._slide`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from numba import types

from hapticd.jit import njit
from hapticd.plant._phases import MOST_PHASES
from hapticd.plant._slide import FORCES, Forces, friction_of, pull_on
from hapticd.plant.effect_terms import damping_at, has_smooth_terms, steady_span
from hapticd.plant.layout import LOAD_OMEGA, LOAD_THETA, OMEGA, THETA
from hapticd.plant.spring import spring_functions

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Coupling(NamedTuple):
    """The coupling of motor and load."""

    inertia: float
    """Of the load [kg m² or kg]."""
    ratio: float
    """μ: of the load to the motor."""
    damping: float
    """ζω₀ [1/s]."""
    stiffness: float
    """ω₀² [1/s²], with the anti-resonance at ω₀."""


_f8 = types.float64
_a = types.Array(_f8, 1, "C")
COUPLING = types.NamedUniTuple(_f8, 4, Coupling)
"""Numba type of `Coupling`."""
_MOTION = types.UniTuple(_f8, 4)

_TERMS = 40
_NEGLIGIBLE = 1e-17
_HALVINGS = 60
_PRECISION = 1e-12
"""How exactly the instant of a stop or a breakaway is found, as a fraction of its phase."""
_BREAKS = 1.0 + 1e-9
"""Factor from kinetic friction to stiction. Without it, a torque equal to friction would start a motion
too short for floating point."""
_SLIGHTEST = 1e-300
"""Smallest torque [N m or N] that moves a motor without friction."""


@njit(_MOTION(_f8, _f8, _f8, _f8, _f8, _f8, _f8, COUPLING), counted=False)
def swing(
    t: float, speed: float, twist: float, twist_rate: float, a: float, rate: float, omega2: float, to: Coupling
) -> tuple[float, float, float, float]:
    """Return displacement, speed, twist and twist rate, in the motor's direction, after a time `t` without a reversal."""
    displacement = 0.0
    y, s, w, r = 0.0, speed, twist, twist_rate
    scale = _NEGLIGIBLE * (abs(speed) + abs(a * t) + abs(twist_rate) + math.sqrt(to.stiffness) * abs(twist))
    push, was_small = a, False
    for n in range(1, _TERMS):
        h = t / n
        q = to.stiffness * w + 2.0 * to.damping * r
        ds = (push - rate * s - omega2 * y + to.ratio * q) * h
        y, w = s * h, r * h
        s, r = ds, -q * h - ds
        displacement += y
        speed += s
        twist += w
        twist_rate += r
        push = 0.0
        is_small = abs(s) + abs(r) <= scale
        if is_small and was_small:
            break
        was_small = is_small
    return displacement, speed, twist, twist_rate


@njit(_f8(_f8, COUPLING, _f8), counted=False, inline=True)
def longest_phase(rate: float, to: Coupling, omega2: float) -> float:
    """Return the time of one radian of the two masses' oscillation, for which their series converges to rounding."""
    return 1.0 / (math.sqrt(to.stiffness * (1.0 + to.ratio) + omega2) + rate)


@njit(_MOTION(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, COUPLING), counted=False)
def swing_apart(
    span: float,
    displacement: float,
    speed: float,
    load_displacement: float,
    load_speed: float,
    a: float,
    rate: float,
    omega2: float,
    to: Coupling,
) -> tuple[float, float, float, float]:
    """Return the differences of two motions, without a reversal of the motor, after `span`: motors, then loads.

    Args:
        span: duration [s].
        displacement: difference of the motors' positions [rad or m]. speed: of their speeds [rad/s or m/s].
        load_displacement: of the loads' positions. load_speed: of their speeds.
        a: of the accelerations that torques on the motors give [rad/s² or m/s²].
        rate: viscous friction of the motor over its inertia [1/s].
        omega2: stiffness on the motor over its inertia [1/s²].
        to: the load.

    Returns:
        Differences of the motors' positions and speeds, and of the loads'.
    """
    parts = math.ceil(span / longest_phase(rate + 2.0 * to.damping * (1.0 + to.ratio), to, omega2))
    twist, twist_rate = load_displacement - displacement, load_speed - speed
    for _ in range(parts):
        further, speed, twist, twist_rate = swing(
            span / parts, speed, twist, twist_rate, a - omega2 * displacement, rate, omega2, to
        )
        displacement += further
    return displacement, speed, displacement + twist, speed + twist_rate


_BRACKET = types.Tuple((_f8, _f8, _f8, _f8, types.int64))


@njit(_f8(_BRACKET), counted=False, inline=True)
def between(bracket: tuple[float, float, float, float, int]) -> float:
    """Return the zero of the chord through both ends of a bracket."""
    early, low, late, high, _ = bracket
    return min(max((early * high - late * low) / (high - low), early), late)


@njit(_BRACKET(_BRACKET, _f8, _f8, types.boolean), counted=False, inline=True)
def narrowed(
    bracket: tuple[float, float, float, float, int], time: float, value: float, is_late: bool
) -> tuple[float, float, float, float, int]:
    """Return a bracket (time and value at each end, the end moved last) with one end moved (Illinois method)."""
    early, low, late, high, moved = bracket
    if is_late:
        return early, 0.5 * low if moved == 1 else low, time, value, 1
    return time, value, late, 0.5 * high if moved == -1 else high, -1


@njit(_f8(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, COUPLING), counted=False)
def _time_of_stop(
    early: float,
    late: float,
    speed: float,
    twist: float,
    twist_rate: float,
    a: float,
    rate: float,
    omega2: float,
    to: Coupling,
) -> float:
    """Return the time of zero speed; the speed is positive at `early` and not at `late`."""
    low = swing(early, speed, twist, twist_rate, a, rate, omega2, to)[1]
    high = swing(late, speed, twist, twist_rate, a, rate, omega2, to)[1]
    bracket, tolerance = (early, low, late, high, 0), _PRECISION * late
    for _ in range(_HALVINGS):
        if not (bracket[2] - bracket[0] > tolerance and bracket[1] > 0.0 > bracket[3]):
            break
        time = between(bracket)
        found = swing(time, speed, twist, twist_rate, a, rate, omega2, to)[1]
        bracket = narrowed(bracket, time, found, found <= 0.0)
    return bracket[2]


@njit(_f8(_f8, _f8, _f8, _f8, _f8, _f8, _f8, COUPLING), counted=False)
def _latest_moving(
    span: float, speed: float, twist: float, twist_rate: float, a: float, rate: float, omega2: float, to: Coupling
) -> float:
    """Return an instant before the first stop of a motor that stops at `span` or has reversed twice by then."""
    time = 0.0 if speed > 0.0 else span
    for _ in range(_HALVINGS):
        if swing(time, speed, twist, twist_rate, a, rate, omega2, to)[1] > 0.0:
            break
        time *= 0.5
    return time


@njit(types.UniTuple(_f8, 2)(_f8, _f8, _f8, COUPLING), counted=False, inline=True)
def swing_on_fixed_end(t: float, twist: float, twist_rate: float, to: Coupling) -> tuple[float, float]:
    """Return twist and twist rate of the load after a time `t`, with the motor at rest."""
    rate, s, c = spring_functions(t, to.damping, to.stiffness)
    return twist * (1.0 - to.stiffness * c) + twist_rate * s, twist_rate * rate - to.stiffness * twist * s


@njit(_f8(_f8, _f8, _f8, _f8, COUPLING), counted=False, inline=True)
def _torque_at_rest(t: float, twist: float, twist_rate: float, pull: float, to: Coupling) -> float:
    """Return the torque on a motor at rest after a time `t`; `pull` is the sum of all torques but the load's."""
    end, end_rate = swing_on_fixed_end(t, twist, twist_rate, to)
    return pull + to.inertia * (to.stiffness * end + 2.0 * to.damping * end_rate)


@njit(_f8(_a, _f8, _f8, _f8, _f8, COUPLING), counted=False)
def _stick(state: NDArray[Any], span: float, x: float, pull: float, level: float, to: Coupling) -> float:
    """Move the load, with the motor at rest, until its torque exceeds stiction; `pull` is the sum of all other torques.

    Returns:
        Duration.
    """
    twist, twist_rate = state[LOAD_THETA] - x, state[LOAD_OMEGA]
    time = span
    torque = _torque_at_rest(span, twist, twist_rate, pull, to)
    least = max(_BREAKS * level, _SLIGHTEST)  # the smallest torque that moves it
    if abs(torque) > least:
        side = math.copysign(1.0, torque)
        low = side * _torque_at_rest(0.0, twist, twist_rate, pull, to) - least
        bracket = 0.0, low, span, side * torque - least, 0
        for _ in range(_HALVINGS):
            if not (bracket[2] - bracket[0] > _PRECISION * span and bracket[1] < 0.0 < bracket[3]):
                break
            middle = between(bracket)
            beyond = side * _torque_at_rest(middle, twist, twist_rate, pull, to) - least
            bracket = narrowed(bracket, middle, beyond, beyond >= 0.0)
        time = bracket[2]
    end, end_rate = swing_on_fixed_end(time, twist, twist_rate, to)
    state[LOAD_THETA], state[LOAD_OMEGA] = x + end, end_rate
    return time


@njit(_f8(_a, _a, _f8, FORCES, COUPLING), counted=False)
def phase_coupled(p: NDArray[Any], state: NDArray[Any], span: float, on: Forces, to: Coupling) -> float:
    """Move motor and load until the motor stops or breaks away, or to the end of `span`; return the duration."""
    x, v = state[THETA], state[OMEGA]
    sign = math.copysign(1.0, v)
    if v == 0.0:
        level = _BREAKS * friction_of(p, 0.0, on)
        pull = pull_on(p, x, x, 0.0, on)
        whole = pull + to.inertia * (to.stiffness * (state[LOAD_THETA] - x) + 2.0 * to.damping * state[LOAD_OMEGA])
        if abs(whole) <= level:
            return _stick(state, span, x, pull, level, to)
        sign = math.copysign(1.0, whole)
    speed = abs(v)
    twist, twist_rate = sign * (state[LOAD_THETA] - x), sign * (state[LOAD_OMEGA] - v)
    displacement, end, end_twist, end_rate, time = 0.0, speed, twist, twist_rate, span
    is_exact = not has_smooth_terms(p)
    for attempt in range(3):
        mean_speed = 0.5 * (speed + end)
        level, viscous = damping_at(p, mean_speed, sign, friction_of(p, mean_speed, on), on.viscous)
        pull = pull_on(p, x, x + sign * displacement, sign * mean_speed, on)
        if attempt == 0:
            whole = pull + sign * to.inertia * (to.stiffness * twist + 2.0 * to.damping * twist_rate)
            span = steady_span(p, speed, sign * whole, on.inertia, span)
        a, rate, omega2 = (
            (sign * pull - level) / on.inertia,
            (viscous + on.damping) / on.inertia,
            on.stiffness / on.inertia,
        )
        time = span
        displacement, end, end_twist, end_rate = swing(span, speed, twist, twist_rate, a, rate, omega2, to)
        first = a - rate * speed + to.ratio * (to.stiffness * twist + 2.0 * to.damping * twist_rate)
        last = (
            a - rate * end - omega2 * displacement + to.ratio * (to.stiffness * end_twist + 2.0 * to.damping * end_rate)
        )
        latest = span
        if end > 0.0 and first < 0.0 < last and min(speed, end) < -first * span:
            # A motor whose speed has a minimum may have stopped there.
            latest = span * first / (first - last)
        if end <= 0.0 or (latest < span and swing(latest, speed, twist, twist_rate, a, rate, omega2, to)[1] <= 0.0):
            early = _latest_moving(latest, speed, twist, twist_rate, a, rate, omega2, to)
            time = _time_of_stop(early, latest, speed, twist, twist_rate, a, rate, omega2, to)
            displacement, _, end_twist, end_rate = swing(time, speed, twist, twist_rate, a, rate, omega2, to)
            end = 0.0
        # A stop shortens the path over which the terms are averaged: repeat.
        if is_exact or (attempt == 1 and time == span):
            break
    state[THETA], state[OMEGA] = x + sign * displacement, sign * end if end > 0.0 else 0.0
    state[LOAD_THETA], state[LOAD_OMEGA] = state[THETA] + sign * end_twist, state[OMEGA] + sign * end_rate
    return time


@njit(types.boolean(_f8, _f8), counted=False, inline=True)
def is_underdamped(ratio: float, damping_ratio: float) -> bool:
    """Whether the two masses oscillate; otherwise their motion is too stiff for a series."""
    return damping_ratio * damping_ratio * (1.0 + ratio) <= 1.0


@njit(types.void(_a, _a, _f8, FORCES, COUPLING), counted=False)
def move_coupled(p: NDArray[Any], state: NDArray[Any], span: float, motor: Forces, to: Coupling) -> None:
    """Move motor and load through a step with constant forces.

    Args:
        p: device vector.
        state: mechanical state, changed in place.
        span: duration [s].
        motor: forces on the motor; the inertia is the motor's only.
        to: the load, `is_underdamped`.
    """
    longest = longest_phase((motor.viscous + motor.damping) / motor.inertia, to, motor.stiffness / motor.inertia)
    remaining = span
    for _ in range(MOST_PHASES):
        parts = math.ceil(remaining / longest)
        remaining -= phase_coupled(p, state, remaining / max(parts, 1.0), motor, to)
        if not remaining > 1e-15 * span:
            break
