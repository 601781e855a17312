"""Mean of a sine over the way of one step: with it a torque that depends on position does exactly its potential's work."""

from __future__ import annotations

import math

from hapticd.jit import njit


@njit("float64(float64, float64)", inline=True)
def mean_sine(middle: float, half: float) -> float:
    """Return the mean of the sine over ``middle`` ± ``half``: sin(middle)·sin(half)/half."""
    if abs(half) < 1e-4:
        return math.sin(middle) * (1.0 - half * half / 6.0)
    return math.sin(middle) * math.sin(half) / half
