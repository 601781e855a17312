"""The paper's criterion (12, 19) as two theorems, with the storage function of a linear spring.

S = ½μξ̇² + ½(1 + κ)ξ² replaces (35). The force of the sample h is −ξ(h) + e with |e| ≤ q: q = ½ for the ticks of
eq. 2, more with dither or a coarse converter (`Dimensionless.quantum`). Coulomb friction of q absorbs e at any speed;
sampling and delay add ∫(ξ − ξ(h))ξ̇, which is at most λ ∫ξ̇² with

    λ(τ_D) = ½[(½ + τ_D) + √((½ + τ_D)² + f(1 − f))],     f = τ_D − ⌊τ_D⌋,

which is ½ + τ_D for whole periods and up to 8 % more between (proofs: docs/explanation/stability.md).

* Theorem 1, τ_D = 0: with σ ≥ q and (β − ½)ξ̇_max + σ − q ≥ 0, S falls from each sample to every later moment of its period.
* Theorem 2: with σ ≥ q and (β − λ)ξ̇_max + σ − q ≥ 0, S never exceeds its initial value plus what the mass may
  gain once, before the first force acts (included in `hapticd.stability.storage.velocity_bound`).

With β ≥ λ and σ ≥ q both hold at every speed: the rendered spring is passive. Margins are in ticks of force; positive:
dissipating. All functions broadcast. Velocities in ticks per period. `hapticd.stability.theorems`: which
configurations a proof covers.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapticd.stability.numbers import Dimensionless

FloatArray = NDArray[np.float64]

#: How many times 1/π² the inertia μ must be to count as "≫" in eq. 11.
SAMPLING_FACTOR: Final = 10.0


def sampling_ratio(numbers: Dimensionless) -> float:
    """ω_s/(2ω_n) = π√(μ/(1 + κ)) (eq. 10); it must be well above one."""
    return math.pi / numbers.omega_n


def sampling_bound_ok(numbers: Dimensionless) -> bool:
    """Whether μ ≫ 1/π² (eq. 11), read as μ ≥ 10/π² (a ratio ω_s/(2ω_n) of at least 3.16)."""
    return sampling_ratio(numbers) ** 2 >= SAMPLING_FACTOR


def lambda_(tau_d: ArrayLike, beta_v: ArrayLike = 0.0) -> FloatArray:
    """λ of theorem 2: the viscous friction β above which sampling and delay generate no energy, at any speed.

    Args:
        tau_d: loop delay τ_D.
        beta_v: virtual damping B/(KT); the energy it may generate is counted, its dissipation is not.
    """
    late = np.asarray(tau_d, dtype=np.float64)
    f = late - np.floor(late)
    x = 0.5 + late + np.asarray(beta_v, dtype=np.float64)
    # in this form a delay of whole periods gives x to the last bit
    return np.asarray(x + 0.5 * (np.sqrt(x * x + f * (1.0 - f)) - x))


def dissipation_margin(
    beta: ArrayLike, sigma: ArrayLike, tau_d: ArrayLike, xi_dot_max: ArrayLike, quantum: ArrayLike = 0.5
) -> FloatArray:
    """(12), and (19) with λ: the minimum of (β − λ)v + σ − q over the speeds v up to ξ̇_max; ≥ 0: the criterion holds.

    Args:
        beta: viscous friction β.
        sigma: Coulomb friction σ.
        tau_d: loop delay τ_D.
        xi_dot_max: velocity bound (13), see `hapticd.stability.storage.velocity_bound`.
        quantum: q, the largest error of the commanded force in ticks.
    """
    b, s, v, q = (np.asarray(x, dtype=np.float64) for x in (beta, sigma, xi_dot_max, quantum))
    return np.asarray(s - q + np.minimum(0.0, (b - lambda_(tau_d)) * v))


def criterion_margin(numbers: Dimensionless, xi_dot_max: float | None) -> float:
    """Margin of one operating point.

    Without a velocity it is the margin at all velocities: min(β − λ, σ − q) (eq. 17, 18).
    """
    if math.isinf(numbers.mu):
        return math.inf
    if xi_dot_max is None:
        return min(passive_margin(numbers), coulomb_margin(numbers))
    n = numbers
    return float(dissipation_margin(n.beta, n.sigma, n.tau_d, xi_dot_max, n.quantum))


def viscous_margin(numbers: Dimensionless) -> float:
    """β − ½ − τ_D: the boundary of Fig. 5 between stability that depends on the speed and stability that does not."""
    # Grouped so that β = ½ + τ_D gives exactly 0.
    return numbers.beta - (0.5 + numbers.tau_d)


def passive_margin(numbers: Dimensionless) -> float:
    """β − λ: viscous friction alone against sampling and delay (eq. 17; b ≥ KT/2 without delay)."""
    return numbers.beta - float(lambda_(numbers.tau_d))


def coulomb_margin(numbers: Dimensionless) -> float:
    """σ − q: Coulomb friction alone against the largest error of the force (eq. 18; c ≥ KΔ/2)."""
    return numbers.sigma - numbers.quantum


def velocity_limit(numbers: Dimensionless) -> float:
    """Largest ξ̇_max for which the criterion holds (eq. 15), (σ − q)/(λ − β).

    Returns:
        ticks per period; infinite if every velocity is allowed, 0 if none is.
    """
    if coulomb_margin(numbers) < 0.0:
        return 0.0
    missing = -passive_margin(numbers)
    if math.isinf(numbers.mu) or missing <= 0.0:
        return math.inf
    return coulomb_margin(numbers) / missing
