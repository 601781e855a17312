"""Motor and load as two masses: with play between them, or joined by a spring and a damper.

The motor has the encoder, the friction, the springs and the hand; the load has only its inertia.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.effects import backlash
from hapticd.jit import effect_term, njit
from hapticd.plant._phases import MOST_PHASES, move, phase
from hapticd.plant._slide import FORCES, Forces
from hapticd.plant.coupled import Coupling, is_underdamped, move_coupled
from hapticd.plant.effect_terms import has_bristle, shared_inertia, whole_inertia
from hapticd.plant.layout import BRISTLE, CONTACT, LOAD_OMEGA, LOAD_THETA, OMEGA, THETA, index_of
from hapticd.plant.spring import spring_functions

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_HALVINGS = 80
_EXACT = 1e-15
"""Fraction of a position, or of a time, that is rounding."""
_GAP_SHARE = index_of("backlash.load_share")
_RESTITUTION = index_of("backlash.restitution")
_CONTACT_STIFFNESS = index_of("backlash.stiffness")
_CONTACT_DAMPING = index_of("backlash.damping")
_common_velocity = effect_term(backlash.common_velocity)
_rebound = effect_term(backlash.rebound)
_FASTEST = (2.0 * math.pi * 1e4) ** 2
"""Square of the angular frequency of the two masses on their contact above which it is taken as rigid."""
_LEAST_REBOUND = 2.0
"""Slowest rebound, in half gaps per second. Slower masses stay together, because rebounds would not end."""
_LOWEST_FLIGHT = 4e-3
"""Four times the height of the lowest rebound that is followed by another one, in half gaps."""
_APART = 1e-9
"""Masses that rebound start this fraction of the half gap apart, so that their next contact can be found."""
_AT_ONCE = 1e-4
"""Fraction of a step that counts as zero: on a bristle, two masses that separate within rounding of the positions meet again
soon after, without end."""


@njit(FORCES(FORCES, _f8, _f8), inline=True)
def with_torque(on: Forces, inertia: float, torque: float) -> Forces:
    """Return the forces on a motor of that inertia, with an additional torque."""
    return Forces(
        on.drive + torque,
        on.motor,
        on.current,
        inertia,
        on.viscous,
        on.damping,
        on.stiffness,
        on.rest,
        on.warm,
        on.time,
    )


@njit(_f8(_a), counted=False, inline=True)
def _reduced_inertia(p: NDArray[Any]) -> float:
    load = shared_inertia(p, p[_GAP_SHARE])
    return load * (1.0 - load / whole_inertia(p))


@njit(types.boolean(_a), counted=False, inline=True)
def is_springy(p: NDArray[Any]) -> bool:
    """Whether the contact of a play is simulated as a spring, not as rigid."""
    return p[_CONTACT_STIFFNESS] < _FASTEST * _reduced_inertia(p)


@njit(_f8(_a), counted=False)
def restitution_of(p: NDArray[Any]) -> float:
    """Return the coefficient of restitution of a rigid contact of motor and load."""
    if p[_CONTACT_STIFFNESS] < math.inf:
        return min(_rebound(p[_CONTACT_STIFFNESS], p[_CONTACT_DAMPING], _reduced_inertia(p)), 0.95)
    return p[_RESTITUTION]


@njit(_f8(_a, _a, _f8, _f8, _f8, FORCES), counted=False)
def _time_of_contact(
    p: NDArray[Any], state: NDArray[Any], latest: float, side: float, half_gap: float, motor: Forces
) -> float:
    """Return the time at which the motor reaches one side of the play; it must do so in this phase.

    The start is the solution for constant acceleration, a parabola through both ends and the first slope; then Newton's
    method, within the bracket.
    """
    early, late = 0.0, latest
    first = side * (state[THETA] - state[LOAD_THETA]) - half_gap
    if first >= 0.0:
        return 0.0
    x, _, _, _ = phase(p, state[THETA], state[OMEGA], state[BRISTLE], latest, motor)
    last = side * (x - state[LOAD_THETA] - state[LOAD_OMEGA] * latest) - half_gap
    slope = side * (state[OMEGA] - state[LOAD_OMEGA])
    curve = (last - first - slope * latest) / (latest * latest)
    root = math.sqrt(max(slope * slope - 4.0 * curve * first, 0.0))
    time = -2.0 * first / (slope + root) if slope > 0.0 else (root - slope) / (2.0 * curve)
    for _ in range(_HALVINGS):
        if not early < time < late:
            time = 0.5 * (early + late)
        x, v, _, taken = phase(p, state[THETA], state[OMEGA], state[BRISTLE], time, motor)
        gap = side * (x - state[LOAD_THETA] - state[LOAD_OMEGA] * taken) - half_gap
        if gap >= 0.0:
            late = time
        else:
            early = time
        if abs(gap) <= _EXACT * (abs(x) + half_gap):
            return time
        if late - early <= _EXACT * latest:
            break
        time -= gap / (side * (v - state[LOAD_OMEGA]))
    return late


@njit(types.void(_a, _a, _f8, FORCES, _f8, _f8), counted=False)
def move_with_backlash(
    p: NDArray[Any], state: NDArray[Any], span: float, joined: Forces, load_inertia: float, half_gap: float
) -> None:
    """Move motor and load, with play between them, through a step with constant forces.

    In contact the two move as one while the contact pushes the load. Then the load coasts until the motor reaches
    a side of the play. The impact conserves momentum: they separate at the closing speed times the restitution, or stay
    together if that is negligible.

    Args:
        p: device vector.
        state: mechanical state, changed in place.
        span: duration [s].
        joined: forces on the motor; the inertia is that of both.
        load_inertia: of the load in it [kg m² or kg].
        half_gap: half the play [rad or m].
    """
    motor = with_torque(joined, joined.inertia - load_inertia, 0.0)
    restitution = restitution_of(p)
    apart = state[THETA] - state[LOAD_THETA]
    if abs(apart) > half_gap:
        state[LOAD_THETA] = state[THETA] - (half_gap if apart > 0.0 else -half_gap)
    remaining = span
    parted = rebounds = False
    flight = 0.0  # since the last rebound in this step
    for _ in range(MOST_PHASES):
        if not remaining > 0.0:
            break
        side = state[CONTACT]
        if side != 0.0:
            x, v, z, time = phase(p, state[THETA], state[OMEGA], state[BRISTLE], remaining, joined)
            # Masses that separate and meet again within the resolution of a phase stay together for a phase.
            if side * (v - state[OMEGA]) >= 0.0 or parted:
                state[THETA], state[OMEGA], state[BRISTLE] = x, v, z
                state[LOAD_THETA], state[LOAD_OMEGA] = x - side * half_gap, v
                remaining -= time
                parted = False
                continue
            state[CONTACT] = 0.0
            parted = True
        x, v, z, time = phase(p, state[THETA], state[OMEGA], state[BRISTLE], remaining, motor)
        load = state[LOAD_THETA] + state[LOAD_OMEGA] * time
        hit = 0.0
        if abs(x - load) > half_gap:
            hit = 1.0 if x > load else -1.0
            time = _time_of_contact(p, state, time, hit, half_gap, motor)
            x, v, z, _ = phase(p, state[THETA], state[OMEGA], state[BRISTLE], time, motor)
            load = x - hit * half_gap
            closing = v - state[LOAD_OMEGA]
            v = _common_velocity(motor.inertia, v, load_inertia, state[LOAD_OMEGA])
            state[LOAD_OMEGA] = v
            rebound = restitution * closing
            # Between two rebounds in a step the flight is a parabola with a quarter of this height.
            is_high = not rebounds or abs(closing) * (flight + time) > _LOWEST_FLIGHT * half_gap
            rebounds = is_high and abs(rebound) > _LEAST_REBOUND * half_gap
            if rebounds:
                v -= rebound * load_inertia / joined.inertia
                state[LOAD_OMEGA] += rebound * motor.inertia / joined.inertia
                load = x - hit * half_gap * (1.0 - _APART)
                hit, flight = 0.0, -time
        state[THETA], state[OMEGA], state[BRISTLE] = x, v, z
        state[LOAD_THETA] = load
        state[CONTACT] = hit
        remaining -= time
        flight += time
        parted = parted and time <= _AT_ONCE * span


@njit(types.void(_a, _a, _f8, FORCES, _f8, _f8, _f8), counted=False)
def swing_behind(
    p: NDArray[Any],
    state: NDArray[Any],
    span: float,
    joined: Forces,
    load_inertia: float,
    damping: float,
    stiffness: float,
) -> None:
    """Move motor and load, joined by a spring and a damper, through a step that is short against their oscillation.

    The load's motion for a motor of constant acceleration is exact for any step; on the motor acts the mean torque of
    the coupling during the step; its part that depends on the motor's acceleration is an inertia. Every step is stable, and
    momentum is conserved to rounding.

    Args:
        p: device vector. state: mechanical state, changed in place. span: duration [s].
        joined: forces on the motor; the inertia is that of both.
        load_inertia: of the load in it [kg m² or kg].
        damping: ζω₀ of the load on its spring [1/s]. stiffness: ω₀² [1/s²].
    """
    rate, s, c = spring_functions(span, damping, stiffness)
    x, v, z = state[THETA], state[OMEGA], state[BRISTLE]
    twist, twist_rate = state[LOAD_THETA] - x, state[LOAD_OMEGA] - v
    # The load's mean acceleration is linear in the motor's: a part of the present twist, plus a fraction of the motor's.
    given = (twist_rate * (rate - 1.0) - stiffness * twist * s) / span
    fraction = 1.0 - s / span
    on = with_torque(joined, joined.inertia - load_inertia * (1.0 - fraction), -load_inertia * given)
    end_x, end_v, end_z = move(p, x, v, z, span, on)
    acceleration = (end_v - v) / span
    state[THETA], state[OMEGA], state[BRISTLE] = end_x, end_v, end_z
    state[LOAD_THETA] = end_x + twist + twist_rate * s - (acceleration + stiffness * twist) * c
    state[LOAD_OMEGA] += (given + fraction * acceleration) * span


@njit(types.void(_a, _a, _f8, FORCES, _f8, _f8, _f8), counted=False)
def move_with_coupling(
    p: NDArray[Any],
    state: NDArray[Any],
    span: float,
    joined: Forces,
    load_inertia: float,
    natural: float,
    damping: float,
) -> None:
    """Move motor and load, joined by a spring and a damper, through a step with constant forces.

    With stiction and an underdamped coupling the motion is exact (`hapticd.plant.coupled`); on a bristle, or with a damper
    too strong for that, it is that of `swing_behind`.

    Args:
        p: device vector.
        state: mechanical state, changed in place.
        span: duration [s]; accurate well below the period of the two masses' oscillation (`substeps_for`).
        joined: forces on the motor; the inertia is that of both.
        load_inertia: of the load in it [kg m² or kg].
        natural: angular anti-resonance frequency 2π f_r [rad/s].
        damping: damping ratio of the load on its spring.
    """
    motor_inertia = joined.inertia - load_inertia
    ratio = load_inertia / motor_inertia
    if is_underdamped(ratio, damping) and not has_bristle(p):
        motor = with_torque(joined, motor_inertia, 0.0)
        move_coupled(p, state, span, motor, Coupling(load_inertia, ratio, damping * natural, natural * natural))
    else:
        swing_behind(p, state, span, joined, load_inertia, damping * natural, natural * natural)
