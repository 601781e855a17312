"""The storage function of the quantised spring (eq. 31–35), and velocities and deflections of equal energy.

H_T(ξ, ξ̇) = ½μξ̇² + ½ξ² + ½(ρ − ρ²), with ρ = ξ − ⌊ξ⌋. The potential part is piecewise linear: on [n, n + 1) it is
½n² + (n + ½)ρ; this form is computed, because it has no cancellation.
All functions broadcast; positions in coarse ticks from the spring's origin, velocities in ticks per period.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def rho(xi: ArrayLike) -> FloatArray:
    """Quantisation error ρ = ξ − ⌊ξ⌋ in [0, 1) (eq. 32)."""
    position = np.asarray(xi, dtype=np.float64)
    return np.asarray(position - np.floor(position))


def potential(xi: ArrayLike) -> FloatArray:
    """Potential energy H_e(ξ) of the quantised spring (eq. 34), in units of KΔ²."""
    position = np.asarray(xi, dtype=np.float64)
    tick = np.floor(position)
    return np.asarray(0.5 * tick * tick + (tick + 0.5) * (position - tick))


def storage(xi: ArrayLike, xi_dot: ArrayLike, mu: ArrayLike, kappa: ArrayLike = 0.0) -> FloatArray:
    """Stored energy H_T(ξ, ξ̇) (eq. 35), in units of KΔ².

    Args:
        xi: position in ticks.
        xi_dot: velocity in ticks per period.
        mu: inertia μ.
        kappa: stiffness of a hand in parallel; its spring stores ½κξ².
    """
    position = np.asarray(xi, dtype=np.float64)
    velocity = np.asarray(xi_dot, dtype=np.float64)
    energy = potential(position) + 0.5 * np.asarray(mu, dtype=np.float64) * velocity * velocity
    return np.asarray(energy + 0.5 * np.asarray(kappa, dtype=np.float64) * position * position)


def equivalent_velocity(xi_0: ArrayLike, mu: ArrayLike, kappa: ArrayLike = 0.0) -> FloatArray:
    """Velocity with the energy of a release at rest from ξ₀ (Sec. V): √(2H_T(ξ₀, 0)/μ), ticks per period."""
    return np.asarray(np.sqrt(2.0 * storage(xi_0, 0.0, mu, kappa) / np.asarray(mu, dtype=np.float64)))


def equivalent_deflection(xi_dot: ArrayLike, mu: ArrayLike) -> FloatArray:
    """Deflection ξ₀ ≥ 0 whose release at rest has the energy ½μξ̇²: the inverse of `equivalent_velocity` (κ = 0)."""
    energy = 0.5 * np.asarray(mu, dtype=np.float64) * np.asarray(xi_dot, dtype=np.float64) ** 2
    tick = np.floor(np.sqrt(2.0 * energy))
    return np.asarray(tick + (energy - 0.5 * tick * tick) / (tick + 0.5))


def velocity_bound(
    xi_0: ArrayLike, xi_dot_0: ArrayLike, mu: ArrayLike, tau_d: ArrayLike = 0.0, kappa: ArrayLike = 0.0
) -> FloatArray:
    """ξ̇_max of eq. 13 from the initial state, for a motion that dissipates from its first force step on.

    Without delay this is √(2H_T/μ), which is |ξ̇₀| when ξ₀ = 0 (eq. 14). With delay no force acts before τ_D: the mass
    coasts at most |ξ̇₀|τ_D, and the energy of the quantised spring may rise accordingly before the proof of Sec. VI-D
    applies. That rise is included; with κ > 0 only for a start at rest or at the origin, because a hand's spring could move
    the mass further.
    """
    start = np.asarray(xi_0, dtype=np.float64)
    velocity = np.asarray(xi_dot_0, dtype=np.float64)
    end = start + velocity * np.asarray(tau_d, dtype=np.float64)
    stored = np.maximum(potential(start), potential(end)) + 0.5 * np.asarray(kappa, dtype=np.float64) * start * start
    # hypot gives exactly |ξ̇₀| when no energy is stored
    return np.asarray(np.hypot(velocity, np.sqrt(2.0 * stored / np.asarray(mu, dtype=np.float64))))
