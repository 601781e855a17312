"""Dither waveforms, unit peak, and the loop's own seeded random numbers (splitmix64).

A waveform is a function of its phase in turns, so that a change of servo rate or frequency never makes it jump.
"""

from __future__ import annotations

import numpy as np

from hapticd.jit import njit
from hapticd.servo.layout import SINE, SQUARE, TRIANGLE

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)


@njit("float64(int64, float64)", counted=False)
def periodic(waveform: int, phase: float) -> float:
    """Sine, triangle or square of unit peak at ``phase`` turns (0 ≤ phase < 1), rising from 0 (square: +1 first)."""
    if waveform == SINE:
        return np.sin(2.0 * np.pi * phase)
    if waveform == TRIANGLE:
        quarter = phase + 0.25
        quarter -= np.floor(quarter)
        return 1.0 - 4.0 * abs(quarter - 0.5)
    if waveform == SQUARE:
        return 1.0 if phase < 0.5 else -1.0
    return 0.0


@njit("Tuple((int64, float64))(int64)", counted=False)
def next_uniform(state: int) -> tuple[int, float]:
    """Next state and a number uniform in [-1, 1) (splitmix64: Steele, Lea, Flood 2014)."""
    word = np.uint64(state) + _GOLDEN
    mixed = word
    mixed = (mixed ^ (mixed >> np.uint64(30))) * _MIX_1
    mixed = (mixed ^ (mixed >> np.uint64(27))) * _MIX_2
    mixed = mixed ^ (mixed >> np.uint64(31))
    return int(word), float(mixed >> np.uint64(11)) * 2.0**-52 - 1.0
