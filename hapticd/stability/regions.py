"""Regions of the (β, σ) plane (Fig. 3 and 5) and their boundaries.

Without delay: A, B, C, D, E. With delay A splits: F1, where the second condition of (19) holds as well and energy falls
all the time, and F2, where it may rise briefly. Points on a boundary count as the better side, as ≥ in (12) does.
Region boundaries are the paper's (q = ½).
"""

from __future__ import annotations

import math
from typing import Final

from hapticd.stability.criterion import coulomb_margin, criterion_margin, viscous_margin, xi_ddot_bound
from hapticd.stability.numbers import Dimensionless

#: What each region means, for people.
MEANING: Final[dict[str, str]] = {
    "A": "globally stable: friction takes out more energy than sampling and quantisation put in, at any speed",
    "B": "buzzes: small steady oscillations, usually below one tick; Coulomb friction cannot hold one tick's step",
    "C": "unstable: neither viscous nor Coulomb friction is enough, oscillations grow from the smallest motion",
    "D": "locally unstable: motions this fast gain energy; slower ones die out",
    "E": "locally stable: Coulomb friction wins as long as the device moves no faster than assumed",
    "F1": "stable with delay: energy falls all the time for motions up to the assumed speed",
    "F2": "stable with delay, but energy may rise briefly before it falls",
    "D|E": "depends on the speed: stable for slow motions, unstable for fast ones; give a velocity or a deflection",
    "F1|F2": "stable with delay; whether energy falls all the time depends on the speed",
}


def region(numbers: Dimensionless, xi_dot_max: float | None = None) -> str:
    """Name of the region of an operating point.

    Args:
        numbers: the operating point; μ matters only with delay, through the a-priori ξ̈_max.
        xi_dot_max: velocity bound (13) in ticks per period; see `hapticd.stability.storage.velocity_bound`.

    Returns:
        ``A`` … ``E`` without delay, ``B`` … ``E``, ``F1``, ``F2`` with it. Without a velocity ``D|E`` and ``F1|F2``
        where it decides.

    Raises:
        ValueError: the velocity is negative or not a number.
    """
    if xi_dot_max is not None and not xi_dot_max >= 0.0:
        raise ValueError(f"xi_dot_max must not be negative, got {xi_dot_max!r}")
    delayed = numbers.tau_d > 0.0
    if math.isinf(numbers.mu):
        return "F1" if delayed else "A"
    viscous_enough = viscous_margin(numbers) >= 0.0
    if coulomb_margin(numbers) < 0.0:
        return "B" if viscous_enough else "C"
    if viscous_enough and not delayed:
        return "A"
    if xi_dot_max is None:
        return "F1|F2" if viscous_enough else "D|E"
    dissipating = criterion_margin(numbers, xi_dot_max) >= 0.0
    if viscous_enough:
        return "F1" if dissipating else "F2"
    return "E" if dissipating else "D"


def critical_sigma(numbers: Dimensionless, xi_dot_max: float, beta: float) -> float:
    """σ on the critical line at β: where (12), or (19) with its second condition, holds with equality (q = ½).

    With delay ξ̈_max contains σ itself; the equation is linear in σ and is solved for it.

    Returns:
        σ on the boundary between E and D (or F1 and F2); infinite when no σ is enough, which happens when the delay is
        so long that τ_D² + τ_D ≥ μ.
    """
    n = numbers
    fraction = (n.tau_d**2 + n.tau_d) / n.mu
    if fraction >= 1.0:
        return math.inf
    without_sigma = float(xi_ddot_bound(n.mu, beta, 0.0, xi_dot_max, n.kappa)) * n.mu
    line = 0.5 + fraction * without_sigma + max(0.0, xi_dot_max * (0.5 + n.tau_d - beta))
    return line / (1.0 - fraction)
