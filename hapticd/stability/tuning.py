"""Limits of single parameters: largest stiffness, delay, tick and period; the grip that makes a device passive.

The criterion is solved for one SI parameter of the loop with the motion fixed in SI units, so that everything that
depends on the parameter changes with it (K is in μ, β, σ, q and, for a release, in ξ̇_max).

**One zero in K.** Multiplied with KΔ, the criterion is c − KqΔ + v(b/T − Kλ)Δ ≥ 0 for all v ≤ ξ̇_max, with KqΔ linear in K.
Up to K = b/(Tλ) the last term is ≥ 0; beyond, it decreases, v being fixed (hand velocity) or growing as √K (release).
So the margin changes sign once, and because it is not positive for the K of σ = q, a solution exists whenever c is larger
than the converter's error. The same holds for T and T_D: λ and Tλ rise with them (by their derivatives, also with f(1 − f)).
In Δ the margin of a release is not monotone (ρ in (35)), so decimations are searched one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hapticd.stability.boundary import boundary
from hapticd.stability.criterion import criterion_margin, lambda_
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
        """Velocity bound (13) in ticks per period; for a release, its equivalent velocity."""
        n, (xi, xi_dot) = loop.numbers, self.to_ticks(loop)
        if loop.stiffness == 0.0:
            return abs(xi_dot)
        return float(velocity_bound(xi, xi_dot, n.mu, n.tau_d, n.kappa))


def margin(loop: Loop, start: Start) -> float:
    """Margin of the criterion for a motion, in ticks of force; ≥ 0: it dissipates."""
    return criterion_margin(loop.numbers, start.xi_dot_max(loop))


def stiffness_max_passive(loop: Loop) -> float:
    """Largest K that is passive, at any speed: Abbott and Okamura's inequality, with delay and with coarser forces.

    K ≤ min(2b/T, 2c/Δ) (J. J. Abbott, A. M. Okamura, IEEE Trans. Robotics 21, 2005; eq. 17, 18 of the paper). With delay
    b/(Tλ) replaces 2b/T; dither and the converter's step reduce c and enlarge Δ.

    Returns:
        K in N m/rad or N/m; 0 if no stiffness is passive.
    """

    def least(K: float) -> float:
        return criterion_margin(replace(loop, stiffness=K).numbers, None)

    viscous = loop.viscous / (loop.period * float(lambda_(loop.delay / loop.period)))
    K = min(viscous, _holding(loop))
    # on the safe side of rounding
    return _largest(least, K * (1.0 + 1e-12), K * (1.0 - 1e-12)) if K > 0.0 else 0.0


def stiffness_max_dissipating(loop: Loop, start: Start) -> float:
    """Largest K for which the criterion holds for a motion with this start, exact to the last bit.

    Returns:
        K in N m/rad or N/m; 0 if it holds for none (too little Coulomb friction).
    """
    highest = _holding(loop)
    return _largest(lambda K: margin(replace(loop, stiffness=K), start), highest) if highest > 0.0 else 0.0


def _holding(loop: Loop) -> float:
    """The K at which Coulomb friction just holds the largest error of the force; 0 if it holds none."""
    return max(0.0, (loop.coulomb - loop.force_error) / ((0.5 + loop.position_error) * loop.resolution))


def grip_damping(loop: Loop) -> float:
    """Smallest damping of a hand that brings β to λ: from E to A (Sec. III-B), with delay to F1.

    Returns:
        KTλ − b in N m s/rad or N s/m, or 0 if the device has enough damping.
    """
    needed = loop.stiffness * loop.period * float(lambda_(loop.delay / loop.period))
    return max(0.0, needed - loop.viscous)


def path(loop: Loop, parameter: Parameter, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The path of the operating point in the (β, σ) plane when K, T or Δ is multiplied by each factor (Fig. 4).

    Returns:
        β and σ, each the shape of `factors`. A larger K moves it straight towards the origin, a larger T lowers β only,
        a larger Δ lowers σ only.
    """
    n, scale = loop.numbers, 1.0 / np.asarray(factors, dtype=np.float64)
    same = np.ones_like(scale)
    beta = n.beta * (same if parameter == "resolution" else scale)
    sigma = n.sigma * (same if parameter == "period" else scale)
    return beta, sigma


def _largest(holds: Callable[[float], float], high: float, low: float = 0.0) -> float:
    """Largest value in [low, high] with a margin ≥ 0, for a margin with one change of sign, from + to −."""
    return high if holds(high) >= 0.0 else boundary(holds, low, high)
