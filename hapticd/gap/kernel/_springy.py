"""A play with a springy contact in the filter: whether it is closed depends on a load known to a few counts at best.

The plant moves the mean, closed or open. The contact's force is not linear: its mean differs from its value at the mean, and
its slope is the stiffness times the probability that it is closed, both for a normal distribution (statistical
linearisation: Roberts and Spanos 1990). Without this, a contact before that of the mean would give no information on the
load, the load would be lost, and the likelihood of its rebounds would not be smooth.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numba import from_dtype, types

from hapticd.gap.kernel.device import LAWS, PERIOD
from hapticd.gap.kernel.modes import MODE, impact
from hapticd.jit import njit
from hapticd.plant.layout import index_of
from hapticd.plant.spring import spring_functions
from hapticd.plant.springy_contact import contact_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_law, _period, _mode = from_dtype(LAWS), from_dtype(PERIOD), from_dtype(MODE)
_GAP = index_of("backlash.gap")
_STIFFNESS = index_of("backlash.stiffness")
_ROOT_2 = math.sqrt(2.0)
_OPEN = 1e-9
"""Probability of a contact below which it is open."""


@njit(_f8(_f8), counted=False, inline=True)
def _rounded(z: float) -> float:
    """Return E[max(0, z + n)] − max(0, z), with n standard normal."""
    return math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi) - 0.5 * abs(z) * math.erfc(abs(z) / _ROOT_2)


@njit(types.UniTuple(_f8, 2)(_a, _mode, _f8, _f8), counted=False)
def blurred(p: NDArray[Any], r: Any, v: float, span: float) -> tuple[float, float]:
    """Return the mean force of the contact minus the force at the mean [N m or N], and the probability that it is closed.

    Args:
        p: device vector. r: piece at the beginning of a period, of `MODE`.
        v: the shaft's mean velocity in it. span: its duration [s].
    """
    S, half_gap = r.covariance, 0.5 * p[_GAP]
    speed = v - r.mean[5]
    middle = r.mean[0] - r.mean[4] + 0.5 * span * speed
    way = S[0, 0] - 2.0 * S[0, 4] + S[4, 4]
    both = S[0, 1] - S[0, 5] - S[4, 1] + S[4, 5]
    variance = max(way + span * both + 0.25 * span * span * (S[1, 1] - 2.0 * S[1, 5] + S[5, 5]), 1e-20)
    deviation = math.sqrt(variance)
    more = _rounded((middle - half_gap) / deviation) - _rounded((middle + half_gap) / deviation)
    reach = _ROOT_2 * math.sqrt(variance + (speed * span) ** 2 / 12.0)  # with the displacement in the period
    closed = 0.5 * (math.erfc((half_gap - middle) / reach) + math.erfc((half_gap + middle) / reach))
    return p[_STIFFNESS] * deviation * more, closed


@njit(types.void(_a, _law, _period, _mode, _f8, _f8, _f8), counted=False)
def touch(p: NDArray[Any], law: Any, period: Any, r: Any, more: float, closed: float, moves: float) -> None:
    """Propagate the covariance of a piece through a contact.

    Args:
        p: device vector. law: one of `LAWS`. period: one of `PERIOD`.
        r: piece at the end of the period as if there were no contact, its mean from the plant; changed in place.
        more, closed: from `blurred`.
        moves: 1 for a shaft that moves, 0 for one at rest.
    """
    load, span = law.passed * law.inertia, period.span
    r.mean[4] += 0.5 * more / load * span * span
    r.mean[5] += more / load * span
    # The disturbance also acts on the load, by its share of the inertia.
    fresh = period.white / law.inertia**2
    r.covariance[4, 4] += span * span / 3.0 * fresh
    r.covariance[4, 5] += 0.5 * span * fresh
    r.covariance[5, 4] += 0.5 * span * fresh
    r.covariance[5, 5] += fresh
    if closed > _OPEN:
        to = contact_of(p, law.inertia - load, load)
        part = closed * (1.0 + moves * to.ratio)
        rate, s, way = spring_functions(span, to.damping * part, to.stiffness * part)
        keeps, slows = 1.0 - to.stiffness * part * way, -to.stiffness * part * s
        # From the end of the motion back to the beginning, then through the contact.
        impact(r, (keeps, s - keeps * span, slows, rate - slows * span), moves * law.passed)
