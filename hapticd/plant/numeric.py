"""Motion of a device with any effects of the catalogue: compiled kernels on its vector and state.

Signal path: command → `hapticd.plant.electrical` → motor current → :func:`mechanical`, tick by tick → :func:`measured`.
`hapticd.plant.layout` has the layouts of device vector and state. With the effects at their neutral values
the result is that of `hapticd.plant.exact`, to the bit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.effects import asymmetric_coulomb, encoder_eccentricity, hand_impedance, thermal_drift
from hapticd.jit import effect_term, njit
from hapticd.plant._phases import move
from hapticd.plant._slide import FORCES, Forces, friction_of, pull_on
from hapticd.plant.effect_terms import (
    coulomb_level,
    has_bristle,
    has_smooth_terms,
    shared_inertia,
    torque_constant,
    viscous_level,
    whole_inertia,
)
from hapticd.plant.layout import BRISTLE, LOAD_OMEGA, LOAD_THETA, OMEGA, THETA, index_of
from hapticd.plant.spring import propagate_about_rest, springs_together
from hapticd.plant.springy_contact import move_with_springy_contact
from hapticd.plant.two_masses import is_springy, move_with_backlash, move_with_coupling

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_i8 = types.int64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")

_GRIP_INERTIA = index_of("grip_inertia")
_GRIP_DAMPING = index_of("grip_damping")
_GRIP_STIFFNESS = index_of("grip_stiffness")
_GRIP_REST = index_of("grip_rest")
_EXTERNAL = index_of("external_force")
_BIAS = index_of("constant_bias.tau_0")
_ASYMMETRIC_COULOMB = index_of("asymmetric_coulomb.a")
_SPRING = index_of("return_spring.k_s")
_SPRING_REST = index_of("return_spring.theta_0")
_KAPPA = index_of("load_dependent_friction.kappa")
_LAG = index_of("amplifier_lag.f_a")
_WARMING = index_of("thermal_drift.r")
_WARMING_TIME = index_of("thermal_drift.t_w")
_HAND_INERTIA = index_of("hand_impedance.m_h")
_HAND_DAMPING = index_of("hand_impedance.b_h")
_HAND_STIFFNESS = index_of("hand_impedance.k_h")
_HAND_ON = index_of("hand_impedance.on_s")
_HAND_OFF = index_of("hand_impedance.off_s")
_HAND_REST = index_of("hand_impedance.rest")
_GAP = index_of("backlash.gap")
_GAP_SHARE = index_of("backlash.load_share")
_RESONANCE = index_of("flexible_coupling.f_r")
_RESONANCE_SHARE = index_of("flexible_coupling.load_share")
_RESONANCE_DAMPING = index_of("flexible_coupling.damping")
_ECCENTRICITY = index_of("encoder_eccentricity.e")
_ECCENTRICITY_PHASE = index_of("encoder_eccentricity.phi")

_asymmetry_torque = effect_term(asymmetric_coulomb.torque)
_measured_angle = effect_term(encoder_eccentricity.measured)
_is_gripped = effect_term(hand_impedance.is_gripped)
_until_switch = effect_term(hand_impedance.until_switch)
_warming_factor = effect_term(thermal_drift.factor)


@njit(FORCES(_a, _f8, _f8), counted=False, inline=True)
def _forces(p: NDArray[Any], time: float, current: float) -> Forces:
    """Return the forces on a device, taken as one mass, at a time [s] with a motor current [A]."""
    motor = current * torque_constant(p)
    drive = motor + p[_EXTERNAL] + p[_BIAS]
    if p[_ASYMMETRIC_COULOMB] != 0.0:
        drive += _asymmetry_torque(coulomb_level(p), p[_ASYMMETRIC_COULOMB])
    warm = _warming_factor(time, p[_WARMING], p[_WARMING_TIME]) if p[_WARMING] != 0.0 else 1.0
    inertia = whole_inertia(p) + p[_GRIP_INERTIA]
    viscous = viscous_level(p)
    damping = p[_GRIP_DAMPING]
    stiffness, rest = p[_GRIP_STIFFNESS], p[_GRIP_REST]
    if p[_SPRING] != 0.0:
        stiffness, rest = springs_together(stiffness, rest, p[_SPRING], p[_SPRING_REST])
    if _is_gripped(time, p[_HAND_ON], p[_HAND_OFF]):
        inertia += p[_HAND_INERTIA]
        damping += p[_HAND_DAMPING]
        if p[_HAND_STIFFNESS] != 0.0:
            stiffness, rest = springs_together(stiffness, rest, p[_HAND_STIFFNESS], p[_HAND_REST])
    return Forces(drive, motor, current, inertia, viscous, damping, stiffness, rest, warm, time)


@njit(types.void(_a, _a, _f8, _f8, _f8), counted=False)
def _move(p: NDArray[Any], state: NDArray[Any], time: float, span: float, current: float) -> None:
    """Move through a time of constant current in which no hand takes or releases the device."""
    on = _forces(p, time + 0.5 * span, current)
    if p[_GAP] > 0.0:
        load_inertia = shared_inertia(p, p[_GAP_SHARE])
        if is_springy(p):
            move_with_springy_contact(p, state, span, on, load_inertia)
        else:
            move_with_backlash(p, state, span, on, load_inertia, 0.5 * p[_GAP])
        return
    if p[_RESONANCE] < math.inf:
        load_inertia = shared_inertia(p, p[_RESONANCE_SHARE])
        natural = 2.0 * math.pi * p[_RESONANCE]
        move_with_coupling(p, state, span, on, load_inertia, natural, p[_RESONANCE_DAMPING])
        return
    if has_smooth_terms(p) or has_bristle(p):
        state[THETA], state[OMEGA], state[BRISTLE] = move(p, state[THETA], state[OMEGA], state[BRISTLE], span, on)
    else:
        level = friction_of(p, 0.0, on)
        viscous = on.viscous + on.damping
        state[THETA], state[OMEGA] = propagate_about_rest(
            state[THETA], state[OMEGA], span, on.drive, on.inertia, viscous, level, on.stiffness, on.rest
        )
    state[LOAD_THETA], state[LOAD_OMEGA] = state[THETA], state[OMEGA]


@njit(types.boolean(_a), counted=False, inline=True)
def has_hand(p: NDArray[Any]) -> bool:
    """Whether a hand holds the device at some time."""
    return p[_HAND_INERTIA] != 0.0 or p[_HAND_DAMPING] != 0.0 or p[_HAND_STIFFNESS] != 0.0


@njit(types.boolean(_a), counted=False)
def needs_effect_terms(p: NDArray[Any]) -> bool:
    """Whether a device has an effect that does not only edit the base model (`edited_base`) or its signals."""
    return (
        has_smooth_terms(p)
        or has_bristle(p)
        or p[_GAP] > 0.0
        or p[_RESONANCE] < math.inf
        or p[_KAPPA] != 0.0
        or p[_WARMING] != 0.0
        or p[_LAG] < math.inf
        or has_hand(p)
    )


@njit(types.UniTuple(_f8, 7)(_a), counted=False)
def edited_base(p: NDArray[Any]) -> tuple[float, float, float, float, float, float, float]:
    """Return the base model, edited by the effects that only edit it.

    Returns:
        Inertia, viscous friction, Coulomb friction, torque constant, bias, stiffness and rest position.
    """
    on = _forces(p, -1.0, 0.0)
    return (
        on.inertia,
        on.viscous + on.damping,
        coulomb_level(p),
        torque_constant(p),
        on.drive,
        on.stiffness,
        on.rest,
    )


@njit(types.UniTuple(_f8, 2)(_a, _f8, _f8, _f8), counted=False)
def holding(p: NDArray[Any], theta: float, time: float, current: float) -> tuple[float, float]:
    """Return the torque on a device at rest, and its stiction."""
    on = _forces(p, time, current)
    return pull_on(p, theta, theta, 0.0, on), friction_of(p, 0.0, on)


@njit(types.void(_a, _a, _f8, _f8, _f8), counted=False)
def substep(p: NDArray[Any], state: NDArray[Any], time: float, span: float, current: float) -> None:
    """Move the device through a substep of constant motor current; arguments as in :func:`mechanical`."""
    if has_hand(p):
        for _ in range(2):
            part = _until_switch(time, span, p[_HAND_ON], p[_HAND_OFF])
            if part < span:
                _move(p, state, time, part, current)
                time += part
                span -= part
    _move(p, state, time, span, current)


@njit(types.void(_a, _a, _f8, _f8, _a), counted=False)
def mechanical(p: NDArray[Any], state: NDArray[Any], t0: float, dt: float, i_sub: NDArray[Any]) -> None:
    """Move the device through one tick.

    Terms that vary within a substep are second-order accurate; stops, breakaway, impacts and the instants of a hand's grip
    are located.

    Args:
        p: device vector, shape (SIZE,).
        state: mechanical state, shape (STATE,), changed in place.
        t0: the plant's time at the start of the tick [s].
        dt: duration of the tick [s].
        i_sub: motor current of each of the equal substeps [A], shape (substeps,).
    """
    h = dt / len(i_sub)
    for k in range(len(i_sub)):
        substep(p, state, t0 + k * h, h, i_sub[k])


@njit(_f8(_a, _f8), counted=False)
def measured(p: NDArray[Any], theta: float) -> float:
    """Return the encoder's position for a true position [rad or m], before quantisation."""
    return _measured_angle(theta, p[_ECCENTRICITY], p[_ECCENTRICITY_PHASE])


@njit(types.void(_a, _a, _m, _i8, _i8, _a, _a), counted=False)
def _simulate_window(
    p: NDArray[Any],
    time_s: NDArray[Any],
    i_sub: NDArray[Any],
    start: int,
    length: int,
    state: NDArray[Any],
    position: NDArray[Any],
) -> None:
    for j in range(length):
        k = start + j
        mechanical(p, state, time_s[k], time_s[k + 1] - time_s[k], i_sub[k])
        position[j] = measured(p, state[THETA])


_WINDOWS = types.void(_a, _a, _m, types.Array(_i8, 1, "C"), _i8, _m, _m, _m)


@njit(_WINDOWS)
def simulate_windows_serial(
    p: NDArray[Any],
    time_s: NDArray[Any],
    i_sub: NDArray[Any],
    start: NDArray[Any],
    length: int,
    state0: NDArray[Any],
    out_position: NDArray[Any],
    out_end: NDArray[Any],
) -> None:
    """Predict the measured position over many windows of a record, each from its own state.

    Args:
        p: device vector, shape (SIZE,).
        time_s: times of the record's n rows [s], strictly rising.
        i_sub: motor current of every row's substeps [A], shape (n, substeps), from `electrical`.
        start: first row of each of the w windows; ``start + length < n``.
        length: ticks of a window.
        state0: mechanical state at each window's first row, shape (w, STATE).
        out_position: measured position at rows start + 1 … start + length, shape (w, length).
        out_end: state after each window, shape (w, STATE).
    """
    for w in range(len(start)):
        out_end[w] = state0[w]
        _simulate_window(p, time_s, i_sub, start[w], length, out_end[w], out_position[w])
