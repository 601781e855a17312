"""Limits on single parameters: largest stiffness, delay, tick and period; the grip that makes a device passive.

The criterion is solved for one SI parameter of the loop with the motion held fixed in SI units, so that everything that
depends on the parameter moves with it (K is in μ, β, σ, the a-priori ξ̈_max and, for a release, in ξ̇_max).

**One crossing in K.** Times K, every criterion reads c/Δ ≥ sup over v ≤ ξ̇_max of K w(v) + Kτ_D(…) − bv/T. For fixed v
the right side does not fall with K: K² T²(φ_max + σ + βv)/m, the part of ξ̈_max, is a sum of rising terms, and the range
of v is fixed (hand velocity) or grows as √K (release). So the margin changes sign once, and since at K = c/(qΔ) it is
not positive, a solution exists whenever c > 0. The same holds for T and T_D. In Δ a release makes ripples (ρ in (35)),
so decimations are searched one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hapticd.stability.boundary import boundary
from hapticd.stability.criterion import QUANTUM, Criterion, criterion_margin, viscous_margin
from hapticd.stability.numbers import Loop
from hapticd.stability.storage import FloatArray, velocity_bound

Parameter = Literal["stiffness", "period", "resolution"]


@dataclass(frozen=True)
class Start:
    """How a motion starts, in SI units measured from the spring's origin.

    Attributes:
        deflection: x(0) in rad or m.
        velocity: ẋ(0) in rad/s or m/s.
    """

    deflection: float = 0.0
    velocity: float = 0.0

    @classmethod
    def in_ticks(cls, loop: Loop, deflection: float = 0.0, velocity: float = 0.0) -> Start:
        """A start given as ξ₀ in coarse ticks and ξ̇₀ in ticks per period of this loop."""
        return cls(loop.scales.xi_to_position(deflection), loop.scales.xi_dot_to_velocity(velocity))

    def to_ticks(self, loop: Loop) -> tuple[float, float]:
        """ξ₀ in coarse ticks and ξ̇₀ in ticks per period of a loop."""
        return loop.scales.position_to_xi(self.deflection), loop.scales.velocity_to_xi_dot(self.velocity)

    def xi_dot_max(self, loop: Loop) -> float:
        """Velocity bound (13) in ticks per period, a release turned into its equivalent velocity."""
        n, (xi, xi_dot) = loop.numbers, self.to_ticks(loop)
        if loop.stiffness == 0.0:
            return abs(xi_dot)
        return float(velocity_bound(xi, xi_dot, n.mu, n.tau_d, n.kappa))


def margin(loop: Loop, start: Start, criterion: Criterion = "paper") -> float:
    """Margin of the criterion for a motion, in ticks' worth of force; ≥ 0 means that it dissipates."""
    return criterion_margin(loop.numbers, start.xi_dot_max(loop), criterion)


def stiffness_max_passive(loop: Loop, criterion: Criterion = "paper", start: Start | None = None) -> float | None:
    """Largest K that keeps the device in A, or in F1 with delay; other parameters fixed.

    Without delay it is min(2b/T, c/(qΔ)) (eq. 17, 18; q = ½ in the paper, 1 where it is proven), whatever the motion.
    With delay no region is passive for all motions (Sec. III-D), and `start` says up to which.

    Returns:
        K in N m/rad or N/m; 0 when no stiffness will do; None when there is delay and no `start`.
    """
    if loop.delay == 0.0:
        return stiffness_max_stable(loop, criterion)
    if start is None:
        return None
    return min(stiffness_max_stable(loop, criterion), stiffness_max_dissipating(loop, start, criterion))


def stiffness_max_stable(loop: Loop, criterion: Criterion = "paper") -> float:
    """Largest K in A, F1 or F2: stable at every speed, with σ ≥ q and β ≥ ½ + τ_D; 0 when no stiffness will do."""
    quantum = QUANTUM[criterion]

    def least(K: float) -> float:
        n = replace(loop, stiffness=K).numbers
        return min(viscous_margin(n), n.sigma - quantum)

    K = min(loop.viscous / (0.5 * loop.period + loop.delay), loop.coulomb / (quantum * loop.resolution))
    # to the right side of its rounding
    return _largest(least, K * (1.0 + 1e-12), K * (1.0 - 1e-12))


def stiffness_max_dissipating(loop: Loop, start: Start, criterion: Criterion = "paper") -> float:
    """Largest K for which the criterion holds for a motion that starts like this, correct to the last bit.

    Returns:
        K in N m/rad or N/m; 0 when no stiffness will do (no Coulomb friction).
    """
    if loop.coulomb == 0.0:
        return 0.0
    highest = loop.coulomb / (QUANTUM[criterion] * loop.resolution)
    return _largest(lambda K: margin(replace(loop, stiffness=K), start, criterion), highest)


def grip_damping(loop: Loop) -> float:
    """Least damping a hand must add to bring β to ½ + τ_D: out of E into A (Sec. III-B), or out of D/E with delay.

    Returns:
        K(T/2 + T_D) − b in N m s/rad or N s/m, or 0 if the device has enough of its own.
    """
    return max(0.0, loop.stiffness * (0.5 * loop.period + loop.delay) - loop.viscous)


def path(loop: Loop, parameter: Parameter, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The way of the operating point in the (β, σ) plane as K, T or Δ is multiplied by each factor (Fig. 4).

    Returns:
        β and σ, each the shape of `factors`. More K leads straight towards the origin, more T lowers β alone, more Δ
        lowers σ alone.
    """
    n, scale = loop.numbers, 1.0 / np.asarray(factors, dtype=np.float64)
    same = np.ones_like(scale)
    beta = n.beta * (same if parameter == "resolution" else scale)
    sigma = n.sigma * (same if parameter == "period" else scale)
    return beta, sigma


def _largest(holds: Callable[[float], float], high: float, low: float = 0.0) -> float:
    """Largest value in [low, high] with a margin ≥ 0, for a margin with one change of sign, from + to −."""
    return high if holds(high) >= 0.0 else boundary(holds, low, high)
