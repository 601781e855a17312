"""The bounds of Sec. VI on generated energy, without delay (47) and with delay (58), compared with an exact motion.

With D = ξ(τ₁) − ξ(l) and d = ξ(l) − ξ(h) they are ½D² + (½ + |d|)|D|. They always hold for S = ½μξ̇² + ½ξ², the energy of
a linear spring, which is sufficient for stability (`hapticd.stability.criterion`). E_g, the energy added to H_T of (35),
also contains ½(ρ − ρ²), and may exceed them if a motion starts very near an encoder edge.

While one force is held, E_g depends on the position only and not on the path. So whether the bound holds at
*every* τ₁ of an interval depends on the range of positions. E_g − bound rises and falls between encoder
edges, but falls from each tick to the next: its supremum lies within the first three ticks, and is computed.
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


def generation_bound(displacement: ArrayLike, late: ArrayLike = 0.0) -> FloatArray:
    """½D² + (½ + |d|)|D| (47, 58).

    Args:
        displacement: D = ξ(τ₁) − ξ(l).
        late: d = ξ(l) − ξ(h), the displacement since the sample.
    """
    D, d = np.broadcast_arrays(np.asarray(displacement, dtype=np.float64), np.asarray(late, dtype=np.float64))
    return np.asarray(0.5 * D * D + (0.5 + np.abs(d)) * np.abs(D))


@dataclass(frozen=True)
class Bounds:
    """The bounds in every interval of a motion with a held force; the coast is left out.

    Attributes:
        displacement: (n,) D over the whole interval. late: (n,) d.
        generated: (n,) E_g over the whole interval.
        excess: (n,) largest E_g − bound at any τ₁ of the interval; positive is a violation.
        scale: (n,) energies that rounding is compared with.
    """

    displacement: FloatArray
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
    return bounds_of_positions(sampled, start, end, low, high)


def bounds_of_positions(
    sampled: FloatArray, start: FloatArray, end: FloatArray, low: FloatArray, high: FloatArray
) -> Bounds:
    """Check the bounds for intervals, given their positions at sample, start, end, minimum and maximum; (n,) in ticks."""
    late, displacement = start - sampled, end - start
    tick, tick_sampled = np.floor(start), np.floor(sampled)
    excess = np.maximum(
        _supremum(tick - tick_sampled, start - tick, late, high - start),
        # mirrored, a reading n becomes −n − 1
        _supremum(tick_sampled - tick, tick + 1.0 - start, -late, start - low),
    )
    scale = 1.0 + generation_bound(np.maximum(high - start, start - low), late)
    return Bounds(displacement, late, generated(tick - tick_sampled, start - tick, displacement), excess, scale)


def _supremum(ticks_late: FloatArray, rho: FloatArray, late: FloatArray, reach: FloatArray) -> FloatArray:
    """Largest E_g − bound over the displacements 0 ≤ D ≤ reach."""
    best = np.zeros_like(reach)
    candidates = [reach, *(np.full_like(reach, float(j)) for j in range(1, _TICKS_SEARCHED))]
    candidates += [j - rho for j in range(1, _TICKS_SEARCHED)]
    candidates += [ticks_late + j - 0.5 - np.abs(late) for j in range(_TICKS_SEARCHED)]
    for candidate in candidates:
        displacement = np.clip(candidate, 0.0, reach)
        best = np.maximum(best, generated(ticks_late, rho, displacement) - generation_bound(displacement, late))
    return best
