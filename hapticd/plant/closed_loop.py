"""The catalogue's effects for commands that come one by one: in the loopback and the simulated hardware.

The kernels of a whole record (`hapticd.plant.numeric`) work on whole ticks; here the plant moves to any instant, and a
step is divided so that no part is longer than the loop's period divided by its substeps.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.jit import njit
from hapticd.plant.effect_terms import coulomb_level, has_bristle, shared_inertia, whole_inertia
from hapticd.plant.electrical import lagged
from hapticd.plant.layout import (
    BRISTLE,
    LOAD_OMEGA,
    LOAD_THETA,
    MOTOR_CURRENT,
    MOTOR_CURRENT_RATE,
    OMEGA,
    THETA,
    index_of,
)
from hapticd.plant.numeric import has_hand, holding, substep
from hapticd.plant.springy_contact import hardest_push
from hapticd.plant.two_masses import is_springy

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")

_LAG = index_of("amplifier_lag.f_a")
_BREAKAWAY = index_of("presliding.breakaway")
_GAP = index_of("backlash.gap")
_GAP_SHARE = index_of("backlash.load_share")
_RESONANCE = index_of("flexible_coupling.f_r")
_RESONANCE_SHARE = index_of("flexible_coupling.load_share")
_HAND_OFF = index_of("hand_impedance.off_s")

# Relative tolerance, so that rounding of a whole number of longest steps adds no further step.
_ROUNDING = 1e-9


@njit(types.void(_a, _a, _f8, _f8, _f8, _f8), counted=False)
def advance_with_effects(
    p: NDArray[Any], state: NDArray[Any], time: float, span: float, longest: float, aim: float
) -> None:
    """Move a device through a time of constant command.

    Args:
        p: device vector, shape (SIZE,).
        state: mechanical state, shape (STATE,), with the motor current; changed in place.
        time: the plant's time at the start [s].
        span: duration [s].
        longest: longest substep [s].
        aim: set point of the amplifier's current [A].
    """
    count = max(math.ceil(span / longest - _ROUNDING), 1)
    h = span / count
    for k in range(count):
        current = aim
        if p[_LAG] < math.inf:
            state[MOTOR_CURRENT], state[MOTOR_CURRENT_RATE], charge = lagged(
                p, state[MOTOR_CURRENT], state[MOTOR_CURRENT_RATE], aim, h
            )
            current = charge / h
        else:
            state[MOTOR_CURRENT] = aim
        substep(p, state, time + k * h, h, current)


@njit(types.boolean(_a, _a, _f8, _f8), counted=False)
def stays_with_effects(p: NDArray[Any], state: NDArray[Any], time: float, aim: float) -> bool:
    """Whether friction holds a device while the command is constant.

    A bristle or a load on a spring may still oscillate: friction must hold the largest torque that the energy of
    the oscillation can give. The answer is no for a load that coasts towards a rigid contact, and for a device that a hand
    will still take or release.
    """
    if time < p[_HAND_OFF] and has_hand(p):
        return False
    inertia = whole_inertia(p)
    pull, level = holding(p, state[THETA], time, aim)
    if p[_LAG] < math.inf:
        pull_now, _ = holding(p, state[THETA], time, state[MOTOR_CURRENT])
        if abs(pull_now) > abs(pull):
            pull = pull_now
    if p[_GAP] > 0.0:
        if is_springy(p):
            level -= hardest_push(p, state, shared_inertia(p, p[_GAP_SHARE]))
        elif state[LOAD_OMEGA] != 0.0:
            return False
    if p[_RESONANCE] < math.inf and not p[_GAP] > 0.0:
        natural = 2.0 * math.pi * p[_RESONANCE]
        twist = state[LOAD_THETA] - state[THETA]
        swing = math.sqrt(twist * twist + (state[LOAD_OMEGA] - state[OMEGA]) ** 2 / (natural * natural))
        level -= p[_RESONANCE_SHARE] * inertia * natural * natural * swing
    if has_bristle(p):
        stiffness = coulomb_level(p) / p[_BREAKAWAY]
        off = pull / stiffness - state[BRISTLE]
        swing = math.sqrt(off * off + inertia * state[OMEGA] * state[OMEGA] / stiffness)
        return abs(pull) + stiffness * swing < level
    return state[OMEGA] == 0.0 and abs(pull) <= level
