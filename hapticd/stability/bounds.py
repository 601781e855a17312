"""The bounds of Sec. VI on generation, without delay (47) and with delay (58), beside what really happens in a motion.

With D = ξ(τ₁) − ξ(l) and d = ξ(l) − ξ(h) they are ½D² + (½ + |d|)|D|. They always hold for S = ½μξ̇² + ½ξ², the energy with
a linear spring, which is all that stability needs (`hapticd.stability.criterion`). E_g, what H_T of (35) receives, also has
the half of ρ − ρ² in it, and may exceed them where a motion starts just beside an encoder edge.

While one force is held, E_g depends on the place alone and not on how the mass got there. So whether the bound holds at
*every* τ₁ of an interval is decided by the places that were visited. E_g less the bound rises and falls between encoder
edges, but from one tick to the next it only falls: its supremum lies within the first three ticks, and is computed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapticd.stability.ledger import Ledger, generated
from hapticd.stability.storage import FloatArray

#: A bound counts as violated when it is exceeded by more than this fraction of the energies involved.
TOLERANCE: Final = 1e-9
_TICKS_SEARCHED = 4


def generation_bound(way: ArrayLike, late: ArrayLike = 0.0) -> FloatArray:
    """½D² + (½ + |d|)|D| (47, 58).

    Args:
        way: D = ξ(τ₁) − ξ(l).
        late: d = ξ(l) − ξ(h), the way made since the sample was taken.
    """
    D, d = np.broadcast_arrays(np.asarray(way, dtype=np.float64), np.asarray(late, dtype=np.float64))
    return np.asarray(0.5 * D * D + (0.5 + np.abs(d)) * np.abs(D))


@dataclass(frozen=True)
class Bounds:
    """What the bounds say of every interval of a motion that held a force; the coast is left out.

    Attributes:
        way: (n,) D over the whole interval. late: (n,) d.
        generated: (n,) E_g over the whole interval.
        excess: (n,) largest E_g − bound at any τ₁ of the interval; positive is a violation.
        scale: (n,) energies with which rounding is to be compared.
    """

    way: FloatArray
    late: FloatArray
    generated: FloatArray
    excess: FloatArray
    scale: FloatArray

    @property
    def violations(self) -> NDArray[np.intp]:
        """Numbers of the intervals in which the bound is exceeded, beyond rounding."""
        return np.flatnonzero(self.excess > TOLERANCE * self.scale)


def check_bounds(account: Ledger) -> Bounds:
    """Check (47) or (58) in every interval of a ledger."""
    first = int(account.coasts)
    start, end = account.xi[first:-1], account.xi[first + 1 :]
    low, high, sampled = account.low[first:], account.high[first:], account.sampled[first:]
    return places_checked(sampled, start, end, low, high)


def places_checked(
    sampled: FloatArray, start: FloatArray, end: FloatArray, low: FloatArray, high: FloatArray
) -> Bounds:
    """Check the bounds on generation for intervals given by the places they sampled and visited, each (n,) in ticks."""
    late, way = start - sampled, end - start
    tick, tick_sampled = np.floor(start), np.floor(sampled)
    excess = np.maximum(
        _supremum(tick - tick_sampled, start - tick, late, high - start),
        # mirrored, a reading n becomes −n − 1
        _supremum(tick_sampled - tick, tick + 1.0 - start, -late, start - low),
    )
    scale = 1.0 + generation_bound(np.maximum(high - start, start - low), late)
    return Bounds(way, late, generated(tick - tick_sampled, start - tick, way), excess, scale)


def _supremum(ticks_late: FloatArray, rho: FloatArray, late: FloatArray, reach: FloatArray) -> FloatArray:
    """Largest E_g − bound over the ways 0 ≤ D ≤ reach."""
    best = np.zeros_like(reach)
    candidates = [reach, *(np.full_like(reach, float(j)) for j in range(1, _TICKS_SEARCHED))]
    candidates += [j - rho for j in range(1, _TICKS_SEARCHED)]
    candidates += [ticks_late + j - 0.5 - np.abs(late) for j in range(_TICKS_SEARCHED)]
    for candidate in candidates:
        way = np.clip(candidate, 0.0, reach)
        best = np.maximum(best, generated(ticks_late, rho, way) - generation_bound(way, late))
    return best
