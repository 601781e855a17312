"""Limit cycles of an operating point from the describing functions, D(M) kept whole: amplitude, frequency, stability.

For every amplitude the real part of (62) gives the frequency and the imaginary part the net gain (`balance`); limit
cycles are its zeros. One is stable where the gain falls through zero as the amplitude grows (Loeb). Below one tick
there is at most one zero, because M times the gain falls with M there. Above, D(M) has a kink with vertical tangent at
every whole tick, so each interval [l, l + 1] is searched with points that crowd at l; from 40 ticks on D is nearly 1
and only the paper's large-amplitude cycle is left. Near β = τ_L the ripple of D about 1 makes a ladder of stable cycles
above one tick: the oscillations of region B that are not "below a single tick".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.describing_function import balance
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.storage import FloatArray

_SEARCHED: Final = 40
_POINTS: Final = 24
_LARGEST: Final = 1e9


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
    _, gain = _balance(numbers, amplitudes)
    crossing = np.flatnonzero(gain[:-1] * gain[1:] < 0.0)
    falling = gain[crossing] > 0.0
    roots = _bisect(numbers, amplitudes[crossing], amplitudes[crossing + 1], falling)
    omega, _ = _balance(numbers, roots)
    return [LimitCycle(float(m), float(w), bool(s)) for m, w, s in zip(roots, omega, falling, strict=True)]


def settled_cycle(numbers: Dimensionless, amplitude: float) -> LimitCycle | None:
    """The stable limit cycle that an oscillation of this amplitude ends in; None if it grows for ever or dies out.

    Args:
        numbers: the operating point.
        amplitude: starting amplitude in ticks, positive.
    """
    _, gain = _balance(numbers, np.array([amplitude]))
    grows = bool(gain[0] > 0.0)
    stable = [c for c in limit_cycles(numbers) if c.stable and (c.amplitude > amplitude) == grows]
    if not stable:
        return None
    return stable[0] if grows else stable[-1]


def predicted_cycle(numbers: Dimensionless) -> LimitCycle | None:
    """The oscillation that the smallest disturbance grows into: None if it dies out, or grows without bound.

    It exists for σ < ½ only (Sec. VII-C).
    """
    return settled_cycle(numbers, float(_search_points()[0])) if np.isfinite(numbers.mu) else None


def _balance(numbers: Dimensionless, amplitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    n = numbers
    return balance(amplitude, n.mu, n.beta, n.sigma, n.tau_l, n.kappa)


def _search_points() -> FloatArray:
    below = np.geomspace(1e-12, 1.0, 64)
    crowded = np.linspace(0.0, 1.0, _POINTS + 1)[1:] ** 3
    inner = (np.arange(1.0, _SEARCHED)[:, None] + crowded).ravel()
    return np.concatenate((below, inner, np.geomspace(_SEARCHED, _LARGEST, 200)[1:]))


def _bisect(numbers: Dimensionless, low: FloatArray, high: FloatArray, falling: NDArray[np.bool_]) -> FloatArray:
    """The zeros of the net gain, one in each bracket; `falling` where the gain is positive at the lower end."""
    for _ in range(54):
        middle = np.sqrt(low * high)
        _, gain = _balance(numbers, middle)
        right = (gain > 0.0) == falling
        low, high = np.where(right, middle, low), np.where(right, high, middle)
    return np.asarray(np.sqrt(low * high))
