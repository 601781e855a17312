"""Spectral lines: sinusoidal torques in time, as from mains, a fan or another machine.

Past motion predicts the phase of such a torque, and so does the current where a controller reacts to it. So a line looks
like structure in the motion, or like lost commands. So lines that the given model leaves are fitted, as sines of time.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from hapticd.gap import constants
from hapticd.gap.terms import LINE, Coordinate, Term

if TYPE_CHECKING:
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit

_LISTED = 3
_SEGMENTS, _LONGEST_SEGMENT = 8, 4096
_AROUND = 50
"""Neighbouring frequencies on each side with which a line is compared."""
_LOWEST_HZ = 5.0
_FINER = 6
"""Steps of the frequency search per resolution of the record (one over its duration)."""


def lines(fit: Fit) -> list[float]:
    """Frequencies [Hz] of lines in the innovations of any recording, the strongest first."""
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
    """Lines of one recording: power over that of the neighbours, frequency [Hz], and half width [Hz]."""
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


def line_term(fit: Fit) -> Term | None:
    """The term of all lines, with a separate amplitude and phase in each recording; None if there are no lines."""
    series, innovations = fit.problem.series, _innovation(fit)
    found: list[tuple[int, float]] = []
    for number, period_s in enumerate(series.periods_s):
        rows = series.recording == number
        time_s = series.time_s[rows]
        reach = _SEGMENTS / time_s[-1]
        own: list[float] = []
        for _, coarse, _ in _lines_of(innovations[rows], period_s):
            frequency = _strongest(innovations[rows], time_s, coarse, reach)
            if all(abs(frequency - other) > reach for other in own):
                own.append(frequency)
        found += [(number, frequency) for frequency in own]
    if not found:
        return None
    # A line may be in the position itself (sampled with another clock): as a torque it then has a large amplitude.
    most, scale = 1e4 * fit.problem.torque, 0.01 * fit.problem.torque
    coordinates = [
        Coordinate(f"{part} of {frequency:.6g} Hz", -1, False, -most, most, scale)
        for _, frequency in found
        for part in ("sine", "cosine")
    ]
    fixed = tuple((-1 - number, frequency) for number, frequency in found)
    return Term(LINE, tuple(coordinates), (0.0,) * len(coordinates), fixed)


def _strongest(innovation: Floats, time_s: Floats, coarse: float, reach: float) -> float:
    """The frequency [Hz] of the largest amplitude near a coarse one."""
    step = 1.0 / (_FINER * float(time_s[-1]))
    turned, turn = (np.exp(-2j * np.pi * one * time_s) for one in (coarse - reach, step))
    turned *= innovation
    swings = []
    for _ in range(2 * _SEGMENTS * _FINER):
        swings.append(abs(turned.sum()))
        turned *= turn
    return coarse - reach + int(np.argmax(swings)) * step


def frequencies(fit: Fit) -> list[float]:
    """Frequencies [Hz] of the fitted lines, and of lines that remain elsewhere: a frequency may drift."""
    series = fit.problem.series
    shortest_s = min(float(series.time_s[series.recording == number][-1]) for number in range(len(series.periods_s)))
    found: list[float] = []
    for one in (*(value for item in fit.terms if item.slug == LINE for _, value in item.fixed), *lines(fit)):
        if all(abs(one - other) > 2.0 * _SEGMENTS / shortest_s for other in found):
            found.append(one)
    return found
