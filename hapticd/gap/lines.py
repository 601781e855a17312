"""Lines: torques that swing in time at a frequency of their own, as mains, a fan or a machine next door leave them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from hapticd.gap import constants

if TYPE_CHECKING:
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit

_LISTED = 3
_SEGMENTS, _LONGEST_SEGMENT = 8, 4096
_AROUND = 50
"""Frequencies to either side that are a line's neighbourhood."""
_LOWEST_HZ = 5.0


def lines(fit: Fit) -> list[float]:
    """Frequencies [Hz] at which the innovations of a model have a line in one of the recordings, the strongest first."""
    series, innovation = fit.problem.series, _innovation(fit)
    found = [
        line
        for number, period_s in enumerate(series.periods_s)
        for line in _lines_of(innovation[series.recording == number], period_s)
    ]
    distinct: list[float] = []
    for _, frequency, width in sorted(found, reverse=True):
        if all(abs(frequency - other) > width for other in distinct):
            distinct.append(frequency)
    return distinct[:_LISTED]


def _lines_of(innovation: Floats, period_s: float) -> list[tuple[float, float, float]]:
    """Power of each line of one recording over that of its neighbourhood, its frequency [Hz], and how far it reaches."""
    length = min(2 ** int(math.log2(2 * innovation.size / _SEGMENTS)), _LONGEST_SEGMENT)
    segments = sliding_window_view(innovation, length)[:: length // 2]
    power = np.mean(np.abs(np.fft.rfft(np.hanning(length) * segments)) ** 2, axis=0)  # Welch 1967
    frequency = np.fft.rfftfreq(length, period_s)
    around = median_filter(power, 2 * _AROUND + 1, mode="mirror")
    found: list[tuple[float, float, float]] = []
    ratio = np.where(frequency > max(_LOWEST_HZ, 2.0 * frequency[1]), power / around, 0.0)
    while ratio.max() > constants.LINE and len(found) < _LISTED:
        k = int(np.argmax(ratio))
        found.append((float(ratio[k]), float(frequency[k]), _AROUND // 5 * float(frequency[1])))
        ratio[max(k - _AROUND // 5, 0) : k + _AROUND // 5] = 0.0
    return found


def _innovation(fit: Fit) -> Floats:
    deviation = np.sqrt(np.maximum(fit.out["variance"] * fit.out["share"], 1e-300))
    return np.asarray(np.clip(fit.out["moved"] / deviation, -5.0, 5.0))
