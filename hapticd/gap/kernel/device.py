"""Properties of a device for the filter, computed once; and the transition of a coupling for each length of a period."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import from_dtype, types

from hapticd.gap.kernel.modes import MODE, SHAFT, STATES, tie
from hapticd.jit import njit
from hapticd.plant.coupled import COUPLING, Coupling, swing_apart, swing_on_fixed_end
from hapticd.plant.effect_terms import shared_inertia
from hapticd.plant.layout import index_of
from hapticd.plant.numeric import edited_base, needs_effect_terms
from hapticd.plant.two_masses import is_springy

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")

FARTHEST_TWIST = 1.0
"""Twist of a coupling [rad or m] beyond which the load is reset to the shaft."""

_NODES, _APART, _TURN_APART = 65, 0.05, 0.03
"""Tabulated period lengths of a coupling, and their relative spacing: largest value, and in radians of the resonance."""

_GAP = index_of("backlash.gap")
_GAP_SHARE = index_of("backlash.load_share")
_RESONANCE = index_of("flexible_coupling.f_r")
_RESONANCE_SHARE = index_of("flexible_coupling.load_share")
_RESONANCE_DAMPING = index_of("flexible_coupling.damping")
_BREAKAWAY = index_of("presliding.breakaway")


@njit(_f8(_a, _f8), counted=False, inline=True)
def moving_inertia(p: NDArray[Any], contact: float) -> float:
    """Return the inertia that a torque on the shaft accelerates at once."""
    inertia = edited_base(p)[0]
    if p[_GAP] > 0.0 and (contact == 0.0 or is_springy(p)):
        inertia -= shared_inertia(p, p[_GAP_SHARE])
    if p[_RESONANCE] < math.inf:
        inertia -= shared_inertia(p, p[_RESONANCE_SHARE])
    return inertia


LAWS = np.dtype(
    [
        ("simple", "?"),  # all effects only edit the base model
        ("remembers", "?"),
        ("has_bristle", "?"),
        ("has_play", "?"),
        ("is_springy", "?"),  # whether the contact of that play is a spring
        ("has_coupling", "?"),
        ("viscous", "f8"),
        ("coulomb", "f8"),
        ("torque_constant", "f8"),
        ("bias", "f8"),
        ("stiffness", "f8"),
        ("inertia", "f8"),
        ("size", "i8"),  # of the state
        ("passed", "f8"),  # share of the inertia of the load behind the play
        ("twist", "f8"),  # usual twist of a coupling [rad or m], and its rate
        ("twist_rate", "f8"),
    ],
    align=True,
)
"""Properties of a device, computed once."""
PERIOD = np.dtype(
    [
        ("time", "f8"),  # at its beginning [s]
        ("span", "f8"),  # T [s]
        ("decay", "f8"),  # of d
        ("mean", "f8"),  # of d over the period, per unit of d at its beginning
        ("white", "f8"),  # variance of the impulse of the white force and of commands that may have been lost
        ("coloured", "f8"),  # variance of the impulse of the innovation of d
        ("fresh", "f8"),  # covariance of that impulse with d at the end
        ("renewed", "f8"),  # variance of the innovation of d
        ("slide", "f8"),  # out: d (velocity at its end) / dw, of all modes
        ("coast", "f8"),  # share of the velocity that the whole shaft keeps
        ("moves", "f8"),  # out: probability that the shaft moves
        (
            "moving",
            "f8",
            (4, 5),
        ),  # transition on a coupling: from x, v, w and the load's x and v to x, v and the load's
        ("held", "f8", (4, 5)),  # the same while friction holds the shaft
        ("usual", "f8"),  # centre of the tabulated period lengths [s], or 0
        ("apart", "f8"),  # their relative spacing
        ("nodes", "f8", (_NODES, 2, 4, 5)),  # both transitions for each length, 0 until first needed
        ("now", "f8", (4, 5)),  # scratch
    ],
    align=True,
)
"""One period, and the noise in it."""
_law, _period, _mode = from_dtype(LAWS), from_dtype(PERIOD), from_dtype(MODE)


@njit(COUPLING(_a), counted=False)
def coupling_of(p: NDArray[Any]) -> Coupling:
    """Return the coupling of motor and load."""
    natural, load = 2.0 * math.pi * p[_RESONANCE], shared_inertia(p, p[_RESONANCE_SHARE])
    return Coupling(load, load / (edited_base(p)[0] - load), p[_RESONANCE_DAMPING] * natural, natural * natural)


@njit(types.void(_a, types.Array(_f8, 2, "C"), _law), counted=False)
def look_up(p: NDArray[Any], current: NDArray[Any], law: Any) -> None:
    """Fill in the properties of a device; `current` is the motor's [A]."""
    law.inertia, law.viscous, law.coulomb, law.torque_constant, law.bias, law.stiffness, _ = edited_base(p)
    law.simple = not needs_effect_terms(p) and law.stiffness == 0.0
    law.has_bristle = p[_BREAKAWAY] > 0.0
    law.has_play = p[_GAP] > 0.0
    law.is_springy = law.has_play and is_springy(p)
    law.has_coupling = p[_RESONANCE] < math.inf and not law.has_play
    law.remembers = law.has_bristle or law.has_play or law.has_coupling
    law.size = STATES if law.has_play or law.has_coupling else SHAFT
    law.passed = shared_inertia(p, p[_GAP_SHARE]) / law.inertia
    if law.has_coupling:
        natural = 2.0 * math.pi * p[_RESONANCE]
        square = 0.0
        for one in current.flat:
            square += one * one
        usual = law.torque_constant * math.sqrt(square / current.size) + law.coulomb
        law.twist = min(usual / law.inertia / natural**2, FARTHEST_TWIST / 4.0)
        law.twist_rate = law.twist * natural


@njit(types.void(_a, _law, _period, _f8), counted=False)
def _couple_exactly(p: NDArray[Any], law: Any, period: Any, span: float) -> None:
    to, inertia = coupling_of(p), moving_inertia(p, 0.0)
    M, H = period.moving, period.held
    rate, omega2 = law.viscous / inertia, law.stiffness / inertia
    M[0, 0], M[1, 0], M[2, 0], M[3, 0] = swing_apart(span, 1.0, 0.0, 0.0, 0.0, 0.0, rate, omega2, to)
    M[0, 1], M[1, 1], M[2, 1], M[3, 1] = swing_apart(span, 0.0, 1.0, 0.0, 0.0, -1.0 / span, rate, omega2, to)
    M[0, 2], M[1, 2], M[2, 2], M[3, 2] = swing_apart(span, 0.0, 0.0, 0.0, 0.0, 1.0 / span, rate, omega2, to)
    M[0, 3], M[1, 3], M[2, 3], M[3, 3] = swing_apart(span, 0.0, 0.0, 1.0, 0.0, 0.0, rate, omega2, to)
    M[0, 4], M[1, 4], M[2, 4], M[3, 4] = swing_apart(span, 0.0, 0.0, 0.0, 1.0, 0.0, rate, omega2, to)
    H[:] = 0.0
    H[0, 0], H[0, 1] = 1.0, 0.5 * span
    H[2, 3], H[3, 3] = swing_on_fixed_end(span, 1.0, 0.0, to)
    H[2, 4], H[3, 4] = swing_on_fixed_end(span, 0.0, 1.0, to)
    H[2, 0], H[3, 0] = 1.0 - H[2, 3], -H[3, 3]


@njit(types.void(_a, _law, _period), counted=False)
def couple(p: NDArray[Any], law: Any, period: Any) -> None:
    """Fill in the transition of small differences of motor and load over a period.

    Because all periods may differ, it is interpolated quadratically between the three nearest nodes, with an error of some
    1e-5; this is only for the linear part. A node is computed when it is first needed.
    """
    if period.usual == 0.0:
        to = coupling_of(p)
        period.usual = period.span
        period.apart = min(_APART, _TURN_APART / (math.sqrt(to.stiffness * (1.0 + to.ratio)) * period.span))
    s = (period.span / period.usual - 1.0) / period.apart
    if abs(s) > _NODES // 2 - 1:
        _couple_exactly(p, law, period, period.span)
        return
    N, middle = period.nodes, round(s)
    for k in range(middle - 1, middle + 2):
        node = k + _NODES // 2
        if N[node, 0, 0, 0] == 0.0:
            _couple_exactly(p, law, period, period.usual * (1.0 + k * period.apart))
            for j in range(4):
                for i in range(5):
                    N[node, 0, j, i], N[node, 1, j, i] = period.moving[j, i], period.held[j, i]
    s -= middle
    before, at, after = 0.5 * s * (s - 1.0), 1.0 - s * s, 0.5 * s * (s + 1.0)
    first = middle + _NODES // 2 - 1
    for j in range(4):
        for k in range(5):
            period.moving[j, k] = (
                before * N[first, 0, j, k] + at * N[first + 1, 0, j, k] + after * N[first + 2, 0, j, k]
            )
            period.held[j, k] = before * N[first, 1, j, k] + at * N[first + 1, 1, j, k] + after * N[first + 2, 1, j, k]


@njit(types.void(_law, _mode), counted=False)
def loosen(law: Any, m: Any) -> None:
    """Reset the load behind a coupling: near the shaft, with its usual oscillation as deviation."""
    tie(m)
    m.covariance[4, 4] += law.twist * law.twist
    m.covariance[5, 5] += law.twist_rate * law.twist_rate
