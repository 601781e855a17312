"""Regions of the (β, σ) plane (Fig. 3 and 5) and their boundaries.

Without delay: A, B, C, D, E. With delay A is divided: F1, where theorem 2 (`hapticd.stability.criterion`) proves this
motion, and F2, where β ≥ ½ + τ_D but a proof would need β ≥ λ. Points on a boundary belong to the more stable region, as ≥
in (12). With q = ½ and no delay the boundaries are the paper's; with delay there is no second condition of (19).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hapticd.stability.criterion import coulomb_margin, criterion_margin, lambda_, passive_margin, viscous_margin
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.storage import FloatArray

#: Meaning of each region, for users.
MEANING: Final[dict[str, str]] = {
    "A": "globally stable: friction takes out more energy than sampling and quantisation put in, at any speed",
    "B": "buzzes: small steady oscillations, usually below one tick; Coulomb friction cannot hold a step of the force",
    "C": "unstable: neither viscous nor Coulomb friction is enough, oscillations grow from the smallest motion",
    "D": "locally unstable: motions this fast can gain energy; slower ones die out",
    "E": "locally stable: Coulomb friction wins as long as the device moves no faster than assumed",
    "F1": "stable with delay: after a pure delay the motion never has more energy than it began with",
    "F2": "stable with delay, but energy may rise before it falls: for this speed nothing is proven",
    "D|E": "depends on the speed: stable for slow motions, unstable for fast ones; give a velocity or a deflection",
    "F1|F2": "stable with delay; whether that is proven depends on the speed",
}


def region(numbers: Dimensionless, xi_dot_max: float | None = None) -> str:
    """Name of the region of an operating point.

    Args:
        numbers: the operating point; its q is ½ in the paper.
        xi_dot_max: velocity bound (13) in ticks per period; see `hapticd.stability.storage.velocity_bound`.

    Returns:
        ``A`` … ``E`` without delay, ``B`` … ``E``, ``F1``, ``F2`` with delay. Without a velocity ``D|E`` and ``F1|F2``
        if the region depends on it.

    Raises:
        ValueError: the velocity is negative or NaN.
    """
    if xi_dot_max is not None and not xi_dot_max >= 0.0:
        raise ValueError(f"xi_dot_max must not be negative, got {xi_dot_max!r}")
    delayed = numbers.tau_d > 0.0
    if math.isinf(numbers.mu):
        return "F1" if delayed else "A"
    viscous_enough = viscous_margin(numbers) >= 0.0
    if coulomb_margin(numbers) < 0.0:
        return "B" if viscous_enough else "C"
    if passive_margin(numbers) >= 0.0:
        return "F1" if delayed else "A"
    if xi_dot_max is None:
        return "F1|F2" if viscous_enough else "D|E"
    dissipating = criterion_margin(numbers, xi_dot_max) >= 0.0
    if viscous_enough:
        return "F1" if dissipating else "F2"
    return "E" if dissipating else "D"


def critical_sigma(numbers: Dimensionless, xi_dot_max: float, beta: ArrayLike) -> FloatArray:
    """σ on the critical line at each β, where the criterion holds with equality: q + ξ̇_max(λ − β), at least q."""
    missing = float(lambda_(numbers.tau_d)) - np.asarray(beta, dtype=np.float64)
    return np.asarray(numbers.quantum + np.maximum(0.0, xi_dot_max * missing))
