"""Describing functions of device and encoder, and the two families of limit cycles (eq. 62–75, Fig. 11, 12).

The loop is assumed to oscillate as ξ = M sin ωτ. The encoder is then the real gain D(M), the device is
G(M, ω), the zero-order hold is half a period of delay, τ_L = ½ + τ_D, and a cycle exists where
G e^{−jτ_Lω} = −1/D (62), that is, where

    D(M) cos τ_Lω = μω² − κ,        D(M) sin τ_Lω = βω + 4σ/(πM).

κ is the stiffness of a hand relative to the spring's, 0 in the paper. D is used without approximation; the paper's
D ≈ 2/(πM) for M < 1 and D ≈ 1 for M > 1 are separate functions. (In (71) the left sides are 1·cos and 1·sin.)
M in ticks, ω in rad per period. Functions broadcast unless stated otherwise.

For every amplitude the real part gives the frequency and the imaginary part the net gain (`balance`), whose zeros are limit
cycles, stable where it decreases through zero as the amplitude grows (Loeb). Below one tick there is at most one: M times
the gain decreases with M there. Above, D(M) has a kink with vertical tangent at every whole tick, so each interval [l, l +
1] is searched with points that are denser near l; from 40 ticks on D is nearly 1 and only the paper's large-amplitude cycle
is left. Near β = τ_L the ripple of D about 1 gives several stable cycles above one tick.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapticd.stability.numbers import Dimensionless

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Above this amplitude D is taken from its asymptote 1; the error is below 2·M^(−3/2).
_ASYMPTOTIC = 1e5
#: Errors up to which a predicted cycle and an exact one count as in agreement.
AMPLITUDE_TOLERANCE: Final = 0.15
FREQUENCY_TOLERANCE: Final = 0.10
_SEARCHED: Final = 40
_POINTS: Final = 24
_LARGEST: Final = 1e9


def encoder_gain(M: ArrayLike) -> FloatArray:
    """D(M) = 2/(πM) + 4/(πM²) Σ √(M² − l²), l = 1 … ⌊M⌋ (eq. 67).

    Args:
        M: (…) amplitude in ticks, positive. From 10⁵ ticks on the gain is 1.
    """
    amplitude = np.asarray(M, dtype=np.float64)
    flat = amplitude.ravel()
    total = np.empty_like(flat)
    for i, m in enumerate(flat):
        steps = np.arange(1.0, np.floor(m) + 1.0) if m < _ASYMPTOTIC else np.empty(0)
        total[i] = np.sqrt((m - steps) * (m + steps)).sum()
    gain = 2.0 / (np.pi * flat) + 4.0 / (np.pi * flat * flat) * total
    return np.where(flat < _ASYMPTOTIC, gain, 1.0).reshape(amplitude.shape)


def encoder_gain_small(M: ArrayLike) -> FloatArray:
    """First term D₁(M) = 2/(πM), equal to D(M) for M ≤ 1 (Fig. 11b)."""
    return np.asarray(2.0 / (np.pi * np.asarray(M, dtype=np.float64)))


def device_response(
    M: ArrayLike, omega: ArrayLike, mu: float, beta: float, sigma: float, kappa: float = 0.0
) -> ComplexArray:
    """G(M, ω) = 1/(κ − μω² + j(βω + 4σ/(πM))) (eq. 66), from actuator force to position."""
    m, w = np.asarray(M, dtype=np.float64), np.asarray(omega, dtype=np.float64)
    return np.asarray(1.0 / (kappa - mu * w * w + 1j * (beta * w + 4.0 * sigma / (np.pi * m))))


def nyquist(
    omega: ArrayLike, mu: float, beta: float, tau_l: float, sigma: float = 0.0, M: float = 1.0, kappa: float = 0.0
) -> ComplexArray:
    """The Nyquist curve G(M, ω)e^{−jτ_Lω} of Fig. 11a; −1/D(M) lies on the negative real axis."""
    w = np.asarray(omega, dtype=np.float64)
    return np.asarray(device_response(M, w, mu, beta, sigma, kappa) * np.exp(-1j * tau_l * w))


def frequency(gain: ArrayLike, mu: float, tau_l: float, kappa: float = 0.0) -> FloatArray:
    """The one ω in (0, π/τ_L) with D cos τ_Lω = μω² − κ, for each gain D > 0; first line of (62), (68), (71).

    Without a hand it lies below π/(2τ_L). NaN if a hand is so stiff that there is none.
    """
    D = np.asarray(gain, dtype=np.float64)
    low, high = np.zeros_like(D), np.full_like(D, np.pi / tau_l)
    exists = D * np.cos(tau_l * high) - mu * high * high + kappa < 0.0
    for _ in range(64):
        middle = 0.5 * (low + high)
        above = D * np.cos(tau_l * middle) - mu * middle * middle + kappa > 0.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.where(exists, 0.5 * (low + high), np.nan)


def balance(M: ArrayLike, numbers: Dimensionless) -> tuple[FloatArray, FloatArray]:
    """Frequency and net gain of an oscillation of amplitude M: (ω, D sin τ_Lω − βω − 4σ/(πM)), ω(M) from `frequency`.

    Net gain positive: the amplitude grows; zero: a limit cycle; negative: it decreases.
    """
    amplitude, n = np.asarray(M, dtype=np.float64), numbers
    gain = encoder_gain(amplitude)
    omega = frequency(gain, n.mu, n.tau_l, n.kappa)
    return omega, np.asarray(gain * np.sin(n.tau_l * omega) - n.beta * omega - 4.0 * n.sigma / (np.pi * amplitude))


def small_amplitude(omega: ArrayLike, mu: float, tau_l: float) -> FloatArray:
    """M = 2 cos(τ_Lω)/(πμω²) of a small oscillation (eq. 69), 0 < ω < π/(2τ_L)."""
    w = np.asarray(omega, dtype=np.float64)
    return np.asarray(2.0 / (np.pi * mu) * np.cos(tau_l * w) / (w * w))


def small_sigma(beta: ArrayLike, omega: ArrayLike, mu: float, tau_l: float) -> FloatArray:
    """σ on the line of a given small oscillation (eq. 70): ½ sin τ_Lω − β cos(τ_Lω)/(2μω).

    It is the second line of (68), σ = (πM/4)(D₁ sin τ_Lω − βω) with D₁ = 2/(πM) and M from (69).
    """
    b, w = np.asarray(beta, dtype=np.float64), np.asarray(omega, dtype=np.float64)
    return np.asarray(0.5 * np.sin(tau_l * w) - b / (2.0 * mu * w) * np.cos(tau_l * w))


def large_sigma(beta: ArrayLike, M: ArrayLike, mu: float, tau_l: float) -> FloatArray:
    """σ on the line of a given large oscillation (eq. 72): (πM/4)(sin τ_Lω − βω), ω from cos τ_Lω = μω² (71)."""
    omega = frequency(1.0, mu, tau_l)
    b, m = np.asarray(beta, dtype=np.float64), np.asarray(M, dtype=np.float64)
    return np.asarray(np.pi * m / 4.0 * (np.sin(tau_l * omega) - b * omega))


def large_frequency_series(mu: float, tau_l: float) -> float:
    """ω ≃ 1/√(μ + ½τ_L²) (eq. 73), the series of the first line of (71)."""
    return float(1.0 / np.sqrt(mu + 0.5 * tau_l * tau_l))


def large_sigma_series(beta: ArrayLike, M: ArrayLike, mu: float, tau_l: float) -> FloatArray:
    """σ ≃ (π/4)Mω(τ_L − β) (eq. 74) with ω from (73)."""
    b, m = np.asarray(beta, dtype=np.float64), np.asarray(M, dtype=np.float64)
    return np.asarray(np.pi / 4.0 * m * large_frequency_series(mu, tau_l) * (tau_l - b))


def stability_sigma(beta: ArrayLike, mu: float, tau_l: float) -> FloatArray:
    """Smallest σ for stability of oscillations above one tick (eq. 75): π(τ_L − β)/(4√μ), for μ ≫ τ_L²/2."""
    return np.asarray(np.pi / (4.0 * np.sqrt(mu)) * (tau_l - np.asarray(beta, dtype=np.float64)))


@dataclass(frozen=True)
class LimitCycle:
    """One self-sustained oscillation ξ = M sin ωτ.

    Attributes:
        amplitude: M in coarse ticks.
        omega: ω in rad per period; `Scales.omega_to_hz` gives Hz.
        stable: whether a slightly different amplitude returns to it.
    """

    amplitude: float
    omega: float
    stable: bool


def limit_cycles(numbers: Dimensionless) -> list[LimitCycle]:
    """All limit cycles of an operating point, smallest amplitude first; none without a spring."""
    if np.isinf(numbers.mu):
        return []
    amplitudes = _search_points()
    _, gain = balance(amplitudes, numbers)
    crossing = np.flatnonzero(gain[:-1] * gain[1:] < 0.0)
    falling = gain[crossing] > 0.0
    roots = _bisect(numbers, amplitudes[crossing], amplitudes[crossing + 1], falling)
    omega, _ = balance(roots, numbers)
    return [LimitCycle(float(m), float(w), bool(s)) for m, w, s in zip(roots, omega, falling, strict=True)]


def settled_cycle(numbers: Dimensionless, amplitude: float) -> LimitCycle | None:
    """The stable limit cycle in which an oscillation of this amplitude ends; None if it grows without bound or dies out.

    Args:
        numbers: the operating point.
        amplitude: starting amplitude in ticks, positive.
    """
    _, gain = balance(np.array([amplitude]), numbers)
    grows = bool(gain[0] > 0.0)
    stable = [c for c in limit_cycles(numbers) if c.stable and (c.amplitude > amplitude) == grows]
    return stable[0 if grows else -1] if stable else None


def predicted_cycle(numbers: Dimensionless) -> LimitCycle | None:
    """The limit cycle that starts from the smallest disturbance; None if that dies out, or grows without bound.

    It exists for σ < ½ only (Sec. VII-C).
    """
    return settled_cycle(numbers, float(_search_points()[0])) if np.isfinite(numbers.mu) else None


def _search_points() -> FloatArray:
    below = np.geomspace(1e-12, 1.0, 64)
    crowded = np.linspace(0.0, 1.0, _POINTS + 1)[1:] ** 3
    inner = (np.arange(1.0, _SEARCHED)[:, None] + crowded).ravel()
    return np.concatenate((below, inner, np.geomspace(_SEARCHED, _LARGEST, 200)[1:]))


def _bisect(numbers: Dimensionless, low: FloatArray, high: FloatArray, falling: NDArray[np.bool_]) -> FloatArray:
    """The zeros of the net gain, one in each bracket; `falling` where the gain is positive at the lower end."""
    for _ in range(54):
        middle = np.sqrt(low * high)
        _, gain = balance(middle, numbers)
        right = (gain > 0.0) == falling
        low, high = np.where(right, middle, low), np.where(right, high, middle)
    return np.asarray(np.sqrt(low * high))
