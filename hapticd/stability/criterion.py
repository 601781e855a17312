"""The dissipation criterion: sampling bound (10, 11), paper (12–19), corrected, and sharp.

Every form says: at every speed v up to ξ̇_max, friction takes out of one period at least what the interface puts in,

    σ + βv ≥ w(v) + τ_D · (largest speed one delay earlier).

They differ in w(v), a bound on the mean force error in a period in which the device moves v ticks:

* ``paper``: w = ½v + ½ (eq. 47). It fails for motions that start just beside an encoder edge.
* ``corrected``: w = ½v + 1, from |ρ(h) − ρ(τ)| < 1. Proven, and more than is needed.
* ``sharp``: w = n + 1 − n(n + 1)/(2v) with n = ⌊v⌋, the exact supremum (`hapticd.stability.sharp`).

Margins are in units of σ, that is, in ticks' worth of force: positive is dissipating. All functions broadcast.
Velocities in ticks per period, accelerations in ticks per period².
"""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapticd.stability.boundary import boundary
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.sharp import sharp_requirement

FloatArray = NDArray[np.float64]
Criterion = Literal["paper", "corrected", "sharp"]

#: What Coulomb friction must exceed at low speed, in ticks of force: ½ in the paper, 1 where it is proven.
QUANTUM: Final[dict[Criterion, float]] = {"paper": 0.5, "corrected": 1.0, "sharp": 1.0}

#: How many times 1/π² the inertia μ must be to count as "≫" in eq. 11.
SAMPLING_FACTOR: Final = 10.0


def sampling_ratio(numbers: Dimensionless) -> float:
    """ω_s/(2ω_n) = π√(μ/(1 + κ)) (eq. 10); it must be well above one."""
    return math.pi / numbers.omega_n


def sampling_bound_ok(numbers: Dimensionless) -> bool:
    """Whether μ ≫ 1/π² (eq. 11), read as μ ≥ 10/π² (a ratio ω_s/(2ω_n) of at least 3.16)."""
    return sampling_ratio(numbers) ** 2 >= SAMPLING_FACTOR


def xi_ddot_bound(
    mu: ArrayLike, beta: ArrayLike, sigma: ArrayLike, xi_dot_max: ArrayLike, kappa: ArrayLike = 0.0
) -> FloatArray:
    """A-priori ξ̈_max = (φ_max + σ + βξ̇_max)/μ of eq. 20, which the paper leaves open.

    φ_max follows from the energy ½μξ̇_max²: the potential (34) is at least ½(1 + κ)ξ², so |ξ| ≤ ξ̇_max √(μ/(1 + κ)), and
    the quantised force is at most |ξ| + ½.
    """
    m, b, s, v, k = (np.asarray(a, dtype=np.float64) for a in (mu, beta, sigma, xi_dot_max, kappa))
    phi_max = v * np.sqrt(m * (1.0 + k)) + 0.5
    return np.asarray((phi_max + s + b * v) / m)


def velocity_margin(
    beta: ArrayLike,
    sigma: ArrayLike,
    xi_dot_max: ArrayLike,
    tau_d: ArrayLike = 0.0,
    xi_ddot_max: ArrayLike = 0.0,
    quantum: ArrayLike = 0.5,
) -> FloatArray:
    """Left side of (19), σ − q − ξ̈_max(τ_D² + τ_D) + ξ̇_max(β − ½ − τ_D).

    With τ_D = 0 it is (12) times ξ̇_max; with ``quantum=0`` the unquantised form (16); with ``quantum=1`` corrected.
    """
    b, v, t = (np.asarray(a, dtype=np.float64) for a in (beta, xi_dot_max, tau_d))
    return np.asarray(rest_margin(sigma, t, xi_ddot_max, quantum) + v * (b - (0.5 + t)))


def rest_margin(
    sigma: ArrayLike, tau_d: ArrayLike = 0.0, xi_ddot_max: ArrayLike = 0.0, quantum: ArrayLike = 0.5
) -> FloatArray:
    """Second condition of (12), with delay: σ − q − ξ̈_max(τ_D² + τ_D), the same balance at vanishing speed.

    The paper states it for τ_D = 0 only; (19) needs it too, because (59) must hold at every speed from zero on.
    """
    s, t, a, q = (np.asarray(x, dtype=np.float64) for x in (sigma, tau_d, xi_ddot_max, quantum))
    return np.asarray(s - q - a * (t * t + t))


def dissipation_margin(
    mu: ArrayLike,
    beta: ArrayLike,
    sigma: ArrayLike,
    tau_d: ArrayLike,
    xi_dot_max: ArrayLike,
    criterion: Criterion = "paper",
    xi_ddot_max: ArrayLike | None = None,
    kappa: ArrayLike = 0.0,
) -> FloatArray:
    """The smallest margin over all speeds up to ξ̇_max; ≥ 0 means that the criterion holds.

    Args:
        mu: inertia μ.
        beta: viscous friction β.
        sigma: Coulomb friction σ.
        tau_d: loop delay τ_D.
        xi_dot_max: velocity bound (13), see `hapticd.stability.storage.velocity_bound`.
        criterion: which criterion.
        xi_ddot_max: acceleration bound (20); the a-priori bound when left out.
        kappa: stiffness κ of a hand in parallel.
    """
    if xi_ddot_max is None:
        xi_ddot_max = xi_ddot_bound(mu, beta, sigma, xi_dot_max, kappa)
    if criterion == "sharp":
        return np.asarray(np.asarray(sigma, dtype=np.float64) - sharp_requirement(beta, xi_dot_max, tau_d, xi_ddot_max))
    quantum = QUANTUM[criterion]
    return np.minimum(
        velocity_margin(beta, sigma, xi_dot_max, tau_d, xi_ddot_max, quantum),
        rest_margin(sigma, tau_d, xi_ddot_max, quantum),
    )


def criterion_margin(numbers: Dimensionless, xi_dot_max: float | None, criterion: Criterion = "paper") -> float:
    """Margin of one operating point.

    Without a velocity it is the margin of what must hold at all velocities: min(β − ½ − τ_D, σ − q) (eq. 17, 18).
    """
    if math.isinf(numbers.mu):
        return math.inf
    if xi_dot_max is None:
        return min(viscous_margin(numbers), numbers.sigma - QUANTUM[criterion])
    n = numbers
    return float(dissipation_margin(n.mu, n.beta, n.sigma, n.tau_d, xi_dot_max, criterion, kappa=n.kappa))


def viscous_margin(numbers: Dimensionless) -> float:
    """β − ½ − τ_D: viscous friction alone against sampling and delay (eq. 17; b ≥ KT/2 without delay)."""
    # Grouped so that a β computed as ½ + τ_D is on the boundary, not a rounding below it.
    return numbers.beta - (0.5 + numbers.tau_d)


def coulomb_margin(numbers: Dimensionless) -> float:
    """σ − ½: Coulomb friction alone against the force step of one tick (eq. 18; c ≥ KΔ/2)."""
    return numbers.sigma - 0.5


def velocity_limit(numbers: Dimensionless, criterion: Criterion = "paper") -> float:
    """Largest ξ̇_max for which the criterion holds (eq. 15; with delay through the a-priori ξ̈_max).

    Returns:
        ticks per period; infinite where every velocity is allowed, 0 where none is.
    """
    n = numbers
    quantum = QUANTUM[criterion]
    if n.sigma < quantum:
        return 0.0
    if n.tau_d == 0.0 and (n.beta >= 0.5 or math.isinf(n.mu)):
        return math.inf
    if n.tau_d == 0.0 and criterion != "sharp":
        return (n.sigma - quantum) / (0.5 - n.beta)

    def margin(v: float) -> float:
        return criterion_margin(numbers, v, criterion)

    if margin(0.0) < 0.0:
        return 0.0
    low, high = 0.0, 1.0
    while margin(high) >= 0.0:
        low, high = high, 2.0 * high
        if math.isinf(high):
            return math.inf
    return boundary(margin, low, high)


def mahvash_hayward_margin(numbers: Dimensionless) -> float:
    """Second condition of (19) under the assumptions of Mahvash and Hayward: ξ̈_max = σ/(βτ_D), no quantisation.

    It is σ(1 − (1 + τ_D)/β), so that τ_D = 1 gives their β ≥ 2; at τ_D = 1 the first condition, β ≥ 3/2 then, follows.
    """
    acceleration = numbers.sigma / (numbers.beta * numbers.tau_d)
    return float(rest_margin(numbers.sigma, numbers.tau_d, acceleration, quantum=0.0))
