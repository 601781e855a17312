"""Proof of growth: the set of states from which a motion certainly grows without bound.

Between two samples the loop of eq. 7–9 is linear except for two bounded disturbances: the quantisation error of the command,
−⌊ξ⌋ − ½ = −ξ + q with |q| ≤ ½, and Coulomb friction, a force f(τ) with |f| ≤ σ whether the mass slides or sticks. With
z = (ξ, ξ̇, pending commands) at a sample and w a left eigenvector of the linear part, wᵀA = λwᵀ,

    |wᵀz(h+1)| ≥ |λ| |wᵀz(h)| − d,      d = ½|wᵀb| + σ(|w_ξ| φ₂ + |w_ξ̇| φ₁)/μ,

where φ₁, φ₂ are those of −β/μ (`hapticd.plant.exact`) and b is the input vector of a command. If |λ| > 1 and once
|wᵀz| > d/(|λ| − 1), it rises in every later period, without bound. If no |λ| exceeds 1, no motion grows without bound.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.plant.exact import phi_functions
from hapticd.stability._current_loop import lagged
from hapticd.stability.criterion import lambda_
from hapticd.stability.whole_loop import is_bare

FloatArray = NDArray[np.float64]

# relative margin for rounding
_MARGIN = 1e-6


@dataclass(frozen=True)
class Escape:
    """The certain growth of one linear loop.

    Attributes:
        gain: largest |λ| of the linear loop, a period.
        real: (2 + pending,) real part of its left eigenvector over (ξ, ξ̇, oldest command … newest).
        imaginary: (2 + pending,) imaginary part.
        command: |wᵀb|.
        friction: |w_ξ|φ₂/μ + |w_ξ̇|φ₁/μ.
    """

    gain: float
    real: FloatArray
    imaginary: FloatArray
    command: float
    friction: float

    def threshold(self, sigma: FloatArray) -> FloatArray:
        """(n,) what |wᵀz| must exceed for growth to be certain; infinite where the linear loop is stable."""
        if self.gain <= 1.0:
            return np.full_like(sigma, np.inf)
        return (0.5 * self.command + sigma * self.friction) / (self.gain - 1.0) * (1.0 + _MARGIN)


def pending_commands(tau_d: float) -> int:
    """Number of pending commands at a sample: ⌊τ_D⌋ + 1, with the one that ends within the period."""
    return math.floor(tau_d) + 1


@functools.lru_cache(maxsize=256)
def escape(mu: float, beta: float, tau_d: float) -> Escape:
    """Eigenvalue, eigenvector and disturbance bound of the loop without quantiser and Coulomb friction."""
    A, b = linear_loop(mu, beta, tau_d)
    values, vectors = np.linalg.eig(A.T)
    k = int(np.argmax(np.abs(values)))
    w = vectors[:, k]
    _, phi1, phi2 = phi_functions(-beta / mu)
    return Escape(
        gain=float(np.abs(values[k])),
        real=np.ascontiguousarray(w.real),
        imaginary=np.ascontiguousarray(w.imag),
        command=float(np.abs(w @ b)),
        friction=float((np.abs(w[0]) * phi2 + np.abs(w[1]) * phi1) / mu),
    )


def linear_loop(mu: float, beta: float, tau_d: float) -> tuple[FloatArray, FloatArray]:
    """The loop from sample to sample without quantiser and Coulomb friction, z(h+1) = A z(h) + b q(h).

    Args:
        mu: inertia μ.
        beta: viscous friction β.
        tau_d: delay τ_D.

    Returns:
        A, (2 + p, 2 + p), and b, (2 + p,), with z = (ξ, ξ̇, φ_C(h − p), …, φ_C(h − 1)), p = ⌊τ_D⌋ + 1; the new command is
        φ_C(h) = −ξ(h) + q(h).
    """
    pending = pending_commands(tau_d)
    fraction = tau_d - math.floor(tau_d)
    size = 2 + pending
    A, b = np.zeros((size, size)), np.zeros(size)
    free_first, force_first = _piece(mu, beta, fraction)
    free_second, force_second = _piece(mu, beta, 1.0 - fraction)
    A[:2, :2] = free_second @ free_first
    A[:2, 2] = free_second @ force_first
    if pending > 1:
        A[:2, 3] += force_second
    else:
        b[:2] = force_second
    for k in range(pending - 1):
        A[2 + k, 3 + k] = 1.0
    b[-1] = 1.0
    A[:, 0] -= b
    return A, b


def _piece(mu: float, beta: float, dt: float) -> tuple[FloatArray, FloatArray]:
    """Free motion and response to a unit force over dt ≤ 1."""
    e, phi1, phi2 = phi_functions(-beta * dt / mu)
    return np.array([[1.0, dt * phi1], [0.0, e]]), np.array([dt * dt * phi2, dt * phi1]) / mu


_LINEAR = ("mu", "beta", "tau_d")


def growth_proofs(loops: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """For proofs of growth: (n,) index of the eigenvector (m, 2, 2 + p), −1 for loops that are not bare; (n,) thresholds."""
    which, thresholds = np.full(loops.size, -1), np.full(loops.size, np.inf)
    places = np.flatnonzero(is_bare(loops))
    alike: dict[tuple[float, ...], list[int]] = {}
    for place, *key in zip(places.tolist(), *(loops[name][places].tolist() for name in _LINEAR), strict=True):
        alike.setdefault(tuple(key), []).append(place)
    linear = [escape(*key) for key in alike]
    growth = np.zeros((max(len(linear), 1), 2, max((loop.real.size for loop in linear), default=0)))
    for k, (loop, members) in enumerate(zip(linear, alike.values(), strict=True)):
        growth[k, :, : loop.real.size] = loop.real, loop.imaginary
        which[members], thresholds[members] = k, loop.threshold(loops["sigma"][members])
    return which, growth, thresholds


def never_grows(loops: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether theorem 2 bounds each loop (n,), for any error of its force: β > λ(τ_D, β_v)."""
    lam = np.asarray(lambda_(loops["tau_d"], loops["beta_v"]))
    for k in np.flatnonzero(loops["natural"]):
        lam[k] = lagged(*(float(loops[name][k]) for name in ("tau_d", "natural", "ratio", "beta_v")))[0]
    return np.asarray((loops["beta"] > lam) & (loops["counts"] == 0))
