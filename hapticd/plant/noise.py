"""Seeded random numbers in compiled code (splitmix64): one integer of state, the same on every machine."""

from __future__ import annotations

import numpy as np

from hapticd.jit import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)


@njit("Tuple((int64, float64))(int64)", counted=False)
def next_uniform(state: int) -> tuple[int, float]:
    """Next state and a number uniform in [-1, 1) (splitmix64: Steele, Lea, Flood 2014)."""
    word = np.uint64(state) + _GOLDEN
    mixed = word
    mixed = (mixed ^ (mixed >> np.uint64(30))) * _MIX_1
    mixed = (mixed ^ (mixed >> np.uint64(27))) * _MIX_2
    mixed = mixed ^ (mixed >> np.uint64(31))
    return int(word), float(mixed >> np.uint64(11)) * 2.0**-52 - 1.0
