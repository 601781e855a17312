"""The laws of the catalogue that act on the shaft, summed over a device vector (`hapticd.plant.effects.layout`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.config.effect_parameters import RIPPLE_ORDERS
from hapticd.jit import njit
from hapticd.plant.effects.asymmetric_viscous import directed_viscous
from hapticd.plant.effects.gravity import gravity_torque
from hapticd.plant.effects.layout import word
from hapticd.plant.effects.load_dependent_friction import load_friction
from hapticd.plant.effects.quadratic_drag import degressive_relief
from hapticd.plant.effects.stribeck import stribeck_factor
from hapticd.plant.effects.torque_ripple import ripple_gain, ripple_torque

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_p = types.Array(_f8, 1, "C")

_COULOMB = word("coulomb")
_COULOMB_ERROR = word("coulomb_friction.r")
_STRIBECK_S = word("stribeck.s")
_STRIBECK_OMEGA = word("stribeck.omega_s")
_KAPPA = word("load_dependent_friction.kappa")
_ASYMMETRIC_VISCOUS = word("asymmetric_viscous.a")
_BREAKAWAY = word("presliding.breakaway")
_DRAG = word("quadratic_drag.d")
_GRAVITY = word("gravity.m_g_l")
_GRAVITY_REST = word("gravity.theta_0")
_ORDERS = word("torque_ripple.orders")
_AMPLITUDES = word("torque_ripple.amplitudes")
_PHASES = word("torque_ripple.phases")
_PROPORTION = word("torque_ripple.current_proportion")

_STRIBECK_PART = 0.5
"""Largest change of speed during a phase, in units of omega_s."""
_STRIBECK_REACH = 4.0
"""Speed, in units of omega_s, from which on friction is as good as constant."""
SMALLEST_BREAKAWAY = 1e-12
"""Breakaway displacement [rad or m] from which on `presliding` differs from stiction."""


@njit(types.boolean(_p), counted=False, inline=True)
def has_smooth_laws(p: NDArray[Any]) -> bool:
    """Whether a law is on that changes with position or speed, so that a step needs its middle."""
    return (
        p[_STRIBECK_S] != 0.0
        or p[_ASYMMETRIC_VISCOUS] != 0.0
        or p[_DRAG] != 0.0
        or p[_GRAVITY] != 0.0
        or p[_ORDERS] != 0.0
    )


@njit(_f8(_p, _f8, _f8, _f8), counted=False, inline=True)
def field_torque(p: NDArray[Any], start: float, end: float, current: float) -> float:
    """Return the torque that depends on position (gravity, ripple), averaged over the way from `start` to `end`."""
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    torque = 0.0
    if p[_GRAVITY] != 0.0:
        torque += gravity_torque(middle - p[_GRAVITY_REST], half, p[_GRAVITY])
    if p[_ORDERS] != 0.0:
        ripple = 0.0
        for k in range(RIPPLE_ORDERS):
            if p[_AMPLITUDES + k] != 0.0:
                ripple += ripple_torque(middle, half, p[_ORDERS + k], p[_AMPLITUDES + k], p[_PHASES + k])
        torque += ripple * ripple_gain(current, p[_PROPORTION])
    return torque


@njit(_f8(_p), counted=False, inline=True)
def coulomb_level(p: NDArray[Any]) -> float:
    """Return the Coulomb friction with its correction."""
    return p[_COULOMB] * (1.0 + p[_COULOMB_ERROR])


@njit(types.boolean(_p), counted=False, inline=True)
def has_bristle(p: NDArray[Any]) -> bool:
    """Whether friction is elastic before it slides, over a way that matters."""
    return p[_BREAKAWAY] >= SMALLEST_BREAKAWAY and coulomb_level(p) > 0.0


@njit(_f8(_p, _f8, _f8, _f8), counted=False, inline=True)
def friction_level(p: NDArray[Any], speed: float, torque: float, warm: float) -> float:
    """Return the Coulomb friction at a speed ≥ 0 under a motor torque, `warm` times that of the cold device.

    At speed 0 it is stiction: what holds the shaft.
    """
    level = coulomb_level(p) * warm
    if p[_STRIBECK_S] != 0.0:
        level *= stribeck_factor(speed, p[_STRIBECK_S], p[_STRIBECK_OMEGA])
    if p[_KAPPA] != 0.0:
        level += load_friction(p[_KAPPA], torque)
    return level


@njit(types.UniTuple(_f8, 2)(_p, _f8, _f8, _f8, _f8), counted=False, inline=True)
def damping_at(p: NDArray[Any], speed: float, direction: float, level: float, viscous: float) -> tuple[float, float]:
    """Return Coulomb and viscous friction that together act at a speed ≥ 0 in a direction ±1.

    Drag that grows is taken as viscous friction d·speed, which no step size makes unstable; drag with d < 0 lowers the
    Coulomb part, and never lets the sum push.
    """
    if p[_ASYMMETRIC_VISCOUS] != 0.0:
        viscous = directed_viscous(viscous, p[_ASYMMETRIC_VISCOUS], direction)
    if p[_DRAG] > 0.0:
        viscous += p[_DRAG] * speed
    elif p[_DRAG] < 0.0:
        level -= degressive_relief(speed, p[_DRAG], level + viscous * speed)
    return level, viscous


@njit(_f8(_p, _f8, _f8, _f8, _f8), counted=False, inline=True)
def stribeck_span(p: NDArray[Any], speed: float, pull: float, inertia: float, span: float) -> float:
    """Return how long friction may be taken at the mean speed: all of `span` where it hardly depends on the speed.

    Args:
        p: device vector.
        speed: present speed ≥ 0.
        pull: sum of all torques but friction, at present.
        inertia: what moves.
        span: longest duration [s].
    """
    if p[_STRIBECK_S] == 0.0:
        return span
    largest = (abs(pull) + coulomb_level(p) * (1.0 + p[_STRIBECK_S])) / inertia
    if speed - largest * span > _STRIBECK_REACH * p[_STRIBECK_OMEGA]:
        return span
    return min(span, _STRIBECK_PART * p[_STRIBECK_OMEGA] / largest)
