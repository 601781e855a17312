"""Stamps that lie on a grid: whole milliseconds, float32 seconds, few digits.

Such a stamp says within which step of the grid a sample was taken. That a clock runs evenly says more: as long as stamps
fit one clock they are spread evenly, within their steps. Where a sample is missing, or the clock was set, another stretch
begins; it goes on with the same clock, some whole periods later, if its stamps admit that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_COARSE = 0.02
"""Step of the grid, in periods, below which its error is less than a percent of a period."""
_JITTER = 0.25
"""Steps by which a sample may be early or late, beside its stamp's rounding, and still fit the clock."""
_ROUNDING = 1e-9
_BREAKS = 0.3
"""Share of the waits of several periods at which a clock that makes them by itself may break, and how few say nothing:"""
_FEW = 8
_ROWS = 200
"""Rows over which a period is measured first, and those that a stretch has at least that others go on with."""
_REFINED = 8
_EVEN = 20
"""Rows of the stretch that a sample is in, in the median, below which the clock is not even: its stamps know more."""


def step_of_stamps(time_s: Floats) -> float:
    """Step of the grid on which stamps lie [s]; 0 where it is so fine that it does not matter, or there is none.

    Args:
        time_s: (n,) stamps.
    """
    waits = np.unique(np.abs(np.diff(time_s)))
    rounding = max(_ROUNDING * float(np.abs(time_s).max(initial=0.0)), 1e-12)
    step = 0.0
    for wait in waits[waits > rounding].tolist():  # Euclid's algorithm, give or take the rounding
        step, rest = (wait, step) if step == 0.0 else (step, wait)
        while rest > rounding:
            step, rest = rest, abs(step - rest * round(step / rest))
            rounding = max(rounding, _ROUNDING * wait)
    period = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    return step if step > _COARSE * period else 0.0


def spread(time_s: Floats) -> tuple[Floats, float]:
    """Instants at which samples were taken whose stamps lie on a grid, and the step of that grid [s].

    Args:
        time_s: (n,) stamps that do not run backwards.

    Returns:
        (n,) instants, and the step; 0 with the stamps as they are where they are on no grid, whole periods apart, or of a
        clock that is less even than the grid is coarse.
    """
    step, waits = step_of_stamps(time_s), np.diff(time_s)
    if step == 0.0 or np.any(waits < 0.0) or np.ptp(waits) < 0.5 * step:
        return time_s, 0.0
    rows = min(_ROWS, time_s.size - 1)
    period = float(np.median(time_s[rows:] - time_s[:-rows])) / rows
    begins = _stretches(time_s, period, step)
    for _ in range(_REFINED):
        refined = _period(time_s, begins)
        refined_begins = _stretches(time_s, refined, step)
        if refined_begins.size > begins.size or refined == period:
            break
        period, begins = refined, refined_begins
    lengths = np.diff(np.append(begins, time_s.size))
    if float(np.median(np.repeat(lengths, lengths))) < _EVEN or _are_missing(waits, step, begins.size - 1):
        return time_s, 0.0
    late = time_s - period * np.arange(time_s.size)
    offset, last = np.empty(time_s.size), None
    for first, end in zip(begins, [*begins[1:], time_s.size], strict=True):
        low, high = float(late[first:end].max()), float(late[first:end].min())
        middle, reach = 0.5 * (low + high), (0.5 + _JITTER) * step - 0.5 * (low - high)
        if last is not None:
            same = last + period * round((middle - last) / period)
            middle = same if abs(same - middle) <= reach else middle
        offset[first:end] = middle
        if last is None or end - first >= _ROWS:
            last = middle
    found = period * np.arange(time_s.size) + offset
    return found if np.all(np.diff(found) > 0.0) else time_s, step


def _are_missing(waits: Floats, step: float, breaks: int) -> bool:
    """Whether rows are missing between exact stamps, and no uneven clock makes their waits of two periods and more."""
    shortest = float(waits.min())
    if not 0.5 * step < shortest < 1.5 * step:
        return False
    longer = int(np.sum(waits > 1.5 * shortest))
    return longer < _FEW or breaks >= _BREAKS * longer


def _stretches(time_s: Floats, period: float, step: float) -> NDArray[np.int64]:
    """First rows of the stretches whose stamps fit a clock of that period."""
    most = (1.0 + 2.0 * _JITTER) * step
    begins, low, high = [0], np.inf, -np.inf
    for row, late in enumerate((time_s - period * np.arange(time_s.size)).tolist()):
        low, high = min(low, late), max(high, late)
        if high - low > most:
            begins.append(row)
            low = high = late
    return np.array(begins)


def _period(time_s: Floats, begins: NDArray[np.int64]) -> float:
    """Period by least squares, with an offset for each stretch."""
    lengths = np.diff(np.append(begins, time_s.size))
    own = np.repeat(np.arange(begins.size), lengths)
    row, stamp = np.arange(time_s.size, dtype=np.float64), time_s.copy()
    for values in (row, stamp):
        values -= (np.bincount(own, values) / lengths)[own]
    return float(row @ stamp / (row @ row))
