"""Mean of a sine over the way of one step: with it a torque that depends on position does exactly its potential's work."""

from __future__ import annotations

import math

from hapticd.jit import njit

_SHORT = 0.1
"""Half way below which five terms of the series of sin(half)/half are exact to rounding, and faster."""


@njit("float64(float64, float64)", inline=True)
def mean_sine(middle: float, half: float) -> float:
    """Return the mean of the sine over ``middle`` ± ``half``: sin(middle)·sin(half)/half."""
    if abs(half) < _SHORT:
        q = half * half
        return math.sin(middle) * (1.0 - q * (1.0 / 6.0 - q * (1.0 / 120.0 - q * (1.0 / 5040.0 - q / 362880.0))))
    return math.sin(middle) * math.sin(half) / half
