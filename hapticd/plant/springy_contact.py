"""Motor and load with play between them, whose contact is a spring and a damper: gears, belts, couplings with a dead zone.

With the motor ahead of the load by more than half the gap, by the deflection x, the contact pushes with

    F = max(0, k·x + c·x′) where x > 0,

and never pulls: it opens when the force is zero, before the deflection is, and closes again when the force returns. So
it is closed where x + min(0, (c/k)·x′) > 0. Open, the load coasts; closed, the two are a coupling (`hapticd.plant.coupled`)
whose rest is at the edge of the gap. The instants of opening and closing are located; the force is continuous there except
the damper's, which begins with the closing speed (Schwager and Pöschel, Granular Matter 9, 2007).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.jit import njit
from hapticd.plant._phases import MOST_PHASES, phase
from hapticd.plant._slide import FORCES, Forces
from hapticd.plant.coupled import COUPLING, Coupling, between, longest_phase, narrowed, phase_coupled
from hapticd.plant.effect_terms import has_bristle
from hapticd.plant.layout import BRISTLE, CONTACT, LOAD_OMEGA, LOAD_THETA, OMEGA, THETA, index_of
from hapticd.plant.two_masses import swing_behind, with_torque

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_GAP = index_of("backlash.gap")
_STIFFNESS = index_of("backlash.stiffness")
_DAMPING = index_of("backlash.damping")
_HALVINGS = 60
_PRECISION = 1e-12
"""How exactly the instant of a change is found, as a fraction of its phase."""
_AT_ONCE = 1e-9
"""Fraction of a step below which the second of two changes is rounding."""
_PART_OF_SWING = 0.1
"""Largest angle [rad] of the oscillation in a phase that is not exact: on a bristle, and with a very strong damper."""
_AT_ONCE_GONE = 2e5
"""Decay rate [1/s] of the relative speed above which a damper is too strong for a series."""


@njit(COUPLING(_a, _f8, _f8), counted=False, inline=True)
def contact_of(p: NDArray[Any], motor_inertia: float, load_inertia: float) -> Coupling:
    """Return the coupling of motor and load while they are in contact."""
    ratio = load_inertia / motor_inertia
    return Coupling(load_inertia, ratio, 0.5 * p[_DAMPING] / load_inertia, p[_STIFFNESS] / load_inertia)


@njit(_f8(_f8, _f8, _f8, _f8), counted=False, inline=True)
def pressed(apart: float, speed: float, half_gap: float, lag: float) -> float:
    """Return the compression of a contact: its force over its stiffness; not positive if it is open.

    Args:
        apart: relative displacement of the sides [rad or m]. speed: its derivative.
        half_gap: half the play. lag: c/k, damping over stiffness [s].
    """
    return apart - half_gap + min(0.0, lag * speed)


@njit(_f8(_f8, _f8, _f8, _f8), counted=False, inline=True)
def _side_pressed(apart: float, speed: float, half_gap: float, lag: float) -> float:
    """Return +1 where the motor pushes the load forwards, −1 backwards, 0 for none; `apart` is the motor less the load."""
    if pressed(apart, speed, half_gap, lag) > 0.0:
        return 1.0
    return -1.0 if pressed(-apart, -speed, half_gap, lag) > 0.0 else 0.0


@njit(_f8(_a, _f8, _f8), counted=False)
def push_of(p: NDArray[Any], apart: float, speed: float) -> float:
    """Return the force [N m or N] on the load; the motor is ahead by `apart` [rad or m], with a relative `speed`."""
    half_gap = 0.5 * p[_GAP]
    side = _side_pressed(apart, speed, half_gap, p[_DAMPING] / p[_STIFFNESS])
    return p[_STIFFNESS] * (apart - side * half_gap) + p[_DAMPING] * speed if side != 0.0 else 0.0


@njit(_f8(_a, _a, _f8, FORCES, COUPLING, _f8), counted=False)
def _phase(p: NDArray[Any], state: NDArray[Any], span: float, joined: Forces, to: Coupling, edge: float) -> float:
    """Move the two through a phase, closed with the rest of the spring at the `edge`, or open; return the duration."""
    motor = with_torque(joined, joined.inertia - to.inertia, 0.0)
    if edge == 0.0:
        x, v, z, time = phase(p, state[THETA], state[OMEGA], state[BRISTLE], span, motor)
        state[THETA], state[OMEGA], state[BRISTLE] = x, v, z
        state[LOAD_THETA] += state[LOAD_OMEGA] * time
        return time
    state[LOAD_THETA] += edge
    decay = 2.0 * to.damping * (1.0 + to.ratio)
    if has_bristle(p) or decay > _AT_ONCE_GONE:
        time = min(span, _PART_OF_SWING * longest_phase(0.0, to, 0.0))
        swing_behind(p, state, time, joined, to.inertia, to.damping, to.stiffness)
    else:
        # Without the small part of friction: the contact is the fast part.
        longest = longest_phase(decay, to, motor.stiffness / motor.inertia)
        time = phase_coupled(p, state, min(span, longest), motor, to)
    state[LOAD_THETA] -= edge
    return time


@njit(types.void(_a, _a, _f8, FORCES, _f8), counted=False)
def move_with_springy_contact(
    p: NDArray[Any], state: NDArray[Any], span: float, joined: Forces, load_inertia: float
) -> None:
    """Move motor and load, with play and a springy contact between them, through a step with constant forces.

    Args:
        p: device vector.
        state: mechanical state, changed in place.
        span: duration [s].
        joined: forces on the motor; the inertia is that of both.
        load_inertia: of the load in it [kg m² or kg].
    """
    to = contact_of(p, joined.inertia - load_inertia, load_inertia)
    half_gap, lag = 0.5 * p[_GAP], p[_DAMPING] / p[_STIFFNESS]
    side = _side_pressed(state[THETA] - state[LOAD_THETA], state[OMEGA] - state[LOAD_OMEGA], half_gap, lag)
    remaining, at_once = span, False
    for _ in range(MOST_PHASES):
        if not remaining > _PRECISION * span:
            break
        x, v, z, load_x, load_v = state[THETA], state[OMEGA], state[BRISTLE], state[LOAD_THETA], state[LOAD_OMEGA]
        time = _phase(p, state, remaining, joined, to, side * half_gap)
        apart, speed = state[THETA] - state[LOAD_THETA], state[OMEGA] - state[LOAD_OMEGA]
        after = _side_pressed(apart, speed, half_gap, lag)
        if after != side and not at_once:
            facing = side if side != 0.0 else after
            sign = -1.0 if side != 0.0 else 1.0
            high = sign * pressed(facing * apart, facing * speed, half_gap, lag)
            low = sign * pressed(facing * (x - load_x), facing * (v - load_v), half_gap, lag)
            low = min(low, -_AT_ONCE * high)  # a phase may begin at a change, within rounding
            bracket, whole = (0.0, low, time, high, 0), time
            for _ in range(_HALVINGS):
                if not (bracket[2] - bracket[0] > _PRECISION * whole and bracket[1] < 0.0 < bracket[3]):
                    break
                trial = between(bracket)
                state[THETA], state[OMEGA], state[BRISTLE], state[LOAD_THETA], state[LOAD_OMEGA] = (
                    x,
                    v,
                    z,
                    load_x,
                    load_v,
                )
                _phase(p, state, trial, joined, to, side * half_gap)
                apart, speed = state[THETA] - state[LOAD_THETA], state[OMEGA] - state[LOAD_OMEGA]
                beyond = sign * pressed(facing * apart, facing * speed, half_gap, lag)
                bracket = narrowed(bracket, trial, beyond, beyond >= 0.0)
            time = bracket[2]
            state[THETA], state[OMEGA], state[BRISTLE], state[LOAD_THETA], state[LOAD_OMEGA] = x, v, z, load_x, load_v
            time = _phase(p, state, time, joined, to, side * half_gap)
            at_once = time <= _AT_ONCE * span
            after = facing if side == 0.0 else 0.0
        else:
            after, at_once = side, False
        side = after
        remaining -= time
    state[CONTACT] = side


@njit(_f8(_a, _a, _f8), counted=False)
def hardest_push(p: NDArray[Any], state: NDArray[Any], load_inertia: float) -> float:
    """Return the largest force [N m or N] of a springy contact on a motor at rest, from the load's energy."""
    deflection = max(abs(state[THETA] - state[LOAD_THETA]) - 0.5 * p[_GAP], 0.0)
    speed = abs(state[LOAD_OMEGA])
    return math.hypot(p[_STIFFNESS] * deflection, math.sqrt(p[_STIFFNESS] * load_inertia) * speed) + p[_DAMPING] * speed
