"""The compiled effect terms that act on the shaft, and their sums for a device vector (`hapticd.plant.layout`)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import types

from hapticd.effects import (
    asymmetric_viscous,
    gravity,
    load_dependent_friction,
    parameters,
    quadratic_drag,
    stribeck,
    torque_ripple,
)
from hapticd.jit import effect_term, njit
from hapticd.plant._hooks import are_installed, are_on, hooked_friction, hooked_torque
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_p = types.Array(_f8, 1, "C")

_INERTIA = index_of("inertia")
_INERTIA_ERROR = index_of("inertia_error.r")
_VISCOUS = index_of("viscous")
_VISCOUS_ERROR = index_of("viscous_friction.r")
_COULOMB = index_of("coulomb")
_COULOMB_ERROR = index_of("coulomb_friction.r")
_TORQUE_CONSTANT = index_of("torque_constant")
_TORQUE_CONSTANT_ERROR = index_of("torque_constant_error.r")
_STRIBECK_S = index_of("stribeck.s")
_STRIBECK_OMEGA = index_of("stribeck.omega_s")
_KAPPA = index_of("load_dependent_friction.kappa")
_ASYMMETRIC_VISCOUS = index_of("asymmetric_viscous.a")
_BREAKAWAY = index_of("presliding.breakaway")
_DRAG = index_of("quadratic_drag.d")
_GRAVITY = index_of("gravity.m_g_l")
_GRAVITY_REST = index_of("gravity.theta_0")
_ORDERS = index_of("torque_ripple.orders")
_AMPLITUDES = index_of("torque_ripple.amplitudes")
_PHASES = index_of("torque_ripple.phases")
_PROPORTION = index_of("torque_ripple.current_proportion")

_corrected = effect_term(parameters.corrected)
_stribeck_factor = effect_term(stribeck.factor)
_load_friction = effect_term(load_dependent_friction.friction)
_directed_viscous = effect_term(asymmetric_viscous.viscous)
_relief = effect_term(quadratic_drag.relief)
_gravity_torque = effect_term(gravity.torque)
_ripple_torque = effect_term(torque_ripple.torque)
_ripple_gain = effect_term(torque_ripple.gain)
_RIPPLE_ORDERS = torque_ripple.ORDERS

STEADY_PART = 0.5
"""Largest change of speed in a phase that takes friction at the mean speed, in units of `speed_scale`."""
_STEADY_REACH = 4.0
"""Speed in those units above which friction counts as constant."""
_SHORT = 0.5 * math.pi
"""Largest angle for which ten terms of the series of sin(a)/a are exact to rounding, and faster."""
SMALLEST_BREAKAWAY = 1e-12
"""Breakaway displacement [rad or m] below which `presliding` is stiction."""


@njit(types.boolean(_p), counted=False, inline=True)
def has_smooth_terms(p: NDArray[Any]) -> bool:
    """Whether a term that changes with position or speed is on, so that a step needs a value at its middle."""
    return (
        p[_STRIBECK_S] != 0.0
        or p[_ASYMMETRIC_VISCOUS] != 0.0
        or p[_DRAG] != 0.0
        or p[_GRAVITY] != 0.0
        or p[_ORDERS] != 0.0
        or (are_installed(p) and are_on(p))
    )


@njit(_f8(_f8), inline=True, reorder=True)
def _sinc(q: float) -> float:
    """Return sin(a)/a for q = a² ≤ `_SHORT`², to rounding: the Taylor series."""
    q2 = q * q
    low = (1.0 - q * (1.0 / 6.0)) + q2 * (1.0 / 120.0 - q * (1.0 / 5040.0))
    high = (1.0 / 362880.0 - q * (1.0 / 39916800.0)) + q2 * (1.0 / 6227020800.0 - q * (1.0 / 1307674368000.0))
    return low + q2 * q2 * (high + q2 * q2 * (1.0 / 355687428096000.0 - q * (1.0 / 121645100408832000.0)))


@njit(_f8(_f8, _f8), inline=True)
def mean_sine(middle: float, half: float) -> float:
    """Return the mean of the sine over ``middle`` ± ``half``, sin(middle)·sin(half)/half.

    Averaged like this over a step, a torque that depends on position does exactly the work of its potential.
    """
    if abs(half) < _SHORT:
        return math.sin(middle) * _sinc(half * half)
    return math.sin(middle) * math.sin(half) / half


@njit(_f8(_p, _f8, _f8), counted=False, reorder=True)
def _ripple(p: NDArray[Any], middle: float, half: float) -> float:
    """Return the mean torque of all orders over ``middle`` ± ``half``; unused orders have amplitude 0.

    Without branches, for vector instructions; each sine is taken of the fraction of a turn.
    """
    orders = ripple = 0.0
    for k in range(_RIPPLE_ORDERS):
        orders += p[_ORDERS + k]
    if orders * abs(half) > _SHORT:
        for k in range(_RIPPLE_ORDERS):
            order = p[_ORDERS + k]
            ripple += _ripple_torque(mean_sine(order * middle + p[_PHASES + k], order * half), p[_AMPLITUDES + k])
        return ripple
    for k in range(_RIPPLE_ORDERS):
        order = p[_ORDERS + k]
        turns = (order * middle + p[_PHASES + k]) * (1.0 / math.tau)
        rest = turns - np.floor(turns) - 0.5  # half a turn is subtracted, so the sine's sign is changed below
        size = abs(rest)
        angle = math.copysign(min(size, 0.5 - size), rest) * math.tau
        angle_half = order * half
        ripple -= _ripple_torque(angle * _sinc(angle * angle) * _sinc(angle_half * angle_half), p[_AMPLITUDES + k])
    return ripple


@njit(_f8(_p, _f8, _f8, _f8, _f8, _f8), counted=False, inline=True)
def field_torque(p: NDArray[Any], start: float, end: float, velocity: float, time: float, current: float) -> float:
    """Return the torque of the terms that depend on position, and of those of other packages.

    Args:
        p: device vector.
        start: position at the start of a path [rad or m], over which the terms of the kernels are averaged exactly.
        end: position at its end; equal to `start` for a device at rest.
        velocity: mean velocity on the path.
        time: the plant's time [s].
        current: motor current [A].
    """
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    torque = 0.0
    if p[_GRAVITY] != 0.0:
        torque += _gravity_torque(mean_sine(middle - p[_GRAVITY_REST], half), p[_GRAVITY])
    if p[_ORDERS] != 0.0:
        torque += _ripple(p, middle, half) * _ripple_gain(current, p[_PROPORTION])
    if are_installed(p):
        torque += hooked_torque(p, middle, velocity, time, current)
    return torque


@njit(_f8(_p), counted=False, inline=True)
def whole_inertia(p: NDArray[Any]) -> float:
    """Return the device's inertia with its correction."""
    return _corrected(p[_INERTIA], p[_INERTIA_ERROR])


@njit(_f8(_p, _f8), counted=False, inline=True)
def shared_inertia(p: NDArray[Any], fraction: float) -> float:
    """Return the part of the device's inertia that is the load's."""
    return _corrected(fraction * p[_INERTIA], p[_INERTIA_ERROR])


@njit(_f8(_p), counted=False, inline=True)
def viscous_level(p: NDArray[Any]) -> float:
    """Return the viscous friction with its correction."""
    return _corrected(p[_VISCOUS], p[_VISCOUS_ERROR])


@njit(_f8(_p), counted=False, inline=True)
def torque_constant(p: NDArray[Any]) -> float:
    """Return the torque constant with its correction."""
    return _corrected(p[_TORQUE_CONSTANT], p[_TORQUE_CONSTANT_ERROR])


@njit(_f8(_p), counted=False, inline=True)
def coulomb_level(p: NDArray[Any]) -> float:
    """Return the Coulomb friction with its correction."""
    return _corrected(p[_COULOMB], p[_COULOMB_ERROR])


@njit(types.boolean(_p), counted=False, inline=True)
def has_bristle(p: NDArray[Any]) -> bool:
    """Whether friction is elastic before it slides, over more than `SMALLEST_BREAKAWAY`."""
    return p[_BREAKAWAY] >= SMALLEST_BREAKAWAY and coulomb_level(p) > 0.0


@njit(_f8(_p, _f8, _f8, _f8, _f8), counted=False, inline=True)
def friction_level(p: NDArray[Any], speed: float, torque: float, warm: float, time: float) -> float:
    """Return the Coulomb friction at a speed ≥ 0, under a motor torque, at a time; `warm`: factor of the temperature.

    At speed 0 it is stiction.
    """
    level = coulomb_level(p) * warm
    if p[_STRIBECK_S] != 0.0:
        level *= _stribeck_factor(speed, p[_STRIBECK_S], p[_STRIBECK_OMEGA])
    if p[_KAPPA] != 0.0:
        level += _load_friction(p[_KAPPA], torque)
    if are_installed(p):
        level = max(level + hooked_friction(p, speed, torque, time), 0.0)
    return level


@njit(types.UniTuple(_f8, 2)(_p, _f8, _f8, _f8, _f8), counted=False, inline=True)
def damping_at(p: NDArray[Any], speed: float, direction: float, level: float, viscous: float) -> tuple[float, float]:
    """Return the Coulomb and viscous friction at a speed ≥ 0 in a direction ±1.

    Drag with d > 0 is taken as viscous friction d·speed, which is stable for any step size; drag with d < 0 lowers the
    Coulomb part, but the sum stays ≥ 0.
    """
    if p[_ASYMMETRIC_VISCOUS] != 0.0:
        viscous = _directed_viscous(viscous, p[_ASYMMETRIC_VISCOUS], direction)
    if p[_DRAG] > 0.0:
        viscous += p[_DRAG] * speed
    elif p[_DRAG] < 0.0:
        level -= _relief(speed, p[_DRAG], level + viscous * speed)
    return level, viscous


@njit(_f8(_p), counted=False, inline=True)
def speed_scale(p: NDArray[Any]) -> float:
    """Return the speed scale of the Coulomb friction; infinite if it does not depend on the speed."""
    return p[_STRIBECK_OMEGA] if p[_STRIBECK_S] != 0.0 else math.inf


@njit(_f8(_p, _f8, _f8, _f8, _f8), counted=False, inline=True)
def steady_span(p: NDArray[Any], speed: float, pull: float, inertia: float, span: float) -> float:
    """Return the duration in which friction may be taken at the mean speed; `span` if it hardly depends on the speed.

    Args:
        p: device vector.
        speed: present speed ≥ 0.
        pull: present sum of all torques but friction, in the direction of motion.
        inertia: moving inertia.
        span: longest duration [s].
    """
    if p[_STRIBECK_S] == 0.0:
        return span
    # While the shaft moves, its friction is between that of fast motion and stiction.
    level = coulomb_level(p)
    largest = max(abs(pull - level), abs(pull - level * (1.0 + p[_STRIBECK_S]))) / inertia
    omega_s = p[_STRIBECK_OMEGA]
    # Far above, half of the difference to the speed where friction begins to rise: other brakes may be as large.
    change = max(STEADY_PART * omega_s, 0.5 * (speed - _STEADY_REACH * omega_s))
    return min(span, change / max(largest, 1e-300))
