"""Dither waveforms of unit peak.

A waveform is a function of its phase in turns, so that it stays continuous when servo rate or frequency change.
"""

from __future__ import annotations

import numpy as np

from hapticd.jit import njit
from hapticd.servo.layout import SINE, SQUARE, TRIANGLE


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
