"""Timing statistics since the start and of the last seconds: differences between present and earlier histograms.

The loop only counts up. The supervisor keeps a copy each second; this needs nothing in the tick.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.servo import atomics, pace
from hapticd.servo.timing import bucket_edges, quantiles_us

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.servo.core import ServoCore

WINDOWS_S: Final = (10, 60)
_EVERY_S: Final = 1.0


@dataclass(frozen=True)
class _Look:
    """The loop's counters at one time."""

    core: ServoCore
    at_s: float
    ticks: int
    missed: int
    exchanges_missed: int
    late: NDArray[np.int64]
    spent: NDArray[np.int64]
    latest_ns: int
    longest_ns: int


class RecentTiming:
    """Counters of the last minute.

    `look` is called by the supervisor, `statistics` by any thread.
    """

    def __init__(self) -> None:
        self._looks: deque[_Look] = deque(maxlen=round(max(WINDOWS_S) / _EVERY_S) + 1)

    def look(self, core: ServoCore, now_s: float) -> None:
        """Copy the counters, if it is time. With a new rig earlier copies are dropped, and counters start at zero."""
        if not self._looks or self._looks[-1].core is not core:
            self._looks.clear()
            self._looks.append(_beginning(core, now_s))
        elif now_s - self._looks[-1].at_s >= _EVERY_S:
            self._looks.append(_taken(core, now_s))

    def statistics(self, core: ServoCore, now_s: float, rate_hz: float) -> dict[str, Any]:
        """Statistics since the start, and in ``last_10_s`` and ``last_60_s`` of these times, as far as they are available.

        All are of the same instant, so a recent count is never above the count since the start.

        Args:
            core: the loop. now_s: of the same clock as in `look`. rate_hz: the servo rate, for the verdict.
        """
        now = _taken(core, now_s)
        looks = [each for each in tuple(self._looks) if each.core is core]
        windows: dict[str, Any] = {}
        for window_s in WINDOWS_S:
            first = _begin(looks, now, window_s)
            span = {"span_s": round(now_s - first.at_s, 3)}
            windows[f"last_{window_s}_s"] = span | _between(first, now, rate_hz)
        return {**_between(_beginning(core, now_s), now, rate_hz), **windows}


def _taken(core: ServoCore, now_s: float) -> _Look:
    return _Look(
        core,
        now_s,
        core.load(atomics.TICKS),
        core.load(atomics.MISSED_PERIODS),
        core.load(atomics.MISSED_EXCHANGES),
        core.late_histogram.copy(),
        core.exec_histogram.copy(),
        core.load(atomics.LATE_MAX_NS),
        core.load(atomics.EXEC_MAX_NS),
    )


def _beginning(core: ServoCore, now_s: float) -> _Look:
    """The counters of a loop at its start."""
    return _Look(core, now_s, 0, 0, 0, np.zeros_like(core.late_histogram), np.zeros_like(core.exec_histogram), 0, 0)


def _begin(looks: list[_Look], now: _Look, window_s: float) -> _Look:
    """The newest look that is old enough, else the oldest."""
    old_enough = [each for each in looks if now.at_s - each.at_s >= window_s]
    return old_enough[-1] if old_enough else looks[0] if looks else _beginning(now.core, now.at_s)


def _between(first: _Look, last: _Look, rate_hz: float) -> dict[str, Any]:
    found = {
        "ticks": last.ticks - first.ticks,
        "missed": last.missed - first.missed,
        "exchanges_missed": last.exchanges_missed - first.exchanges_missed,
        "wake_us": _quantiles(last.late, first.late, last.latest_ns),
        "exec_us": _quantiles(last.spent, first.spent, last.longest_ns),
    }
    return {**found, "verdict": pace.verdict(found, rate_hz)}


def _quantiles(last: NDArray[np.int64], first: NDArray[np.int64], largest_ns: int) -> dict[str, float | None]:
    """As `quantiles_us`, of the values between two looks; exact to the width of a bucket, 3 %, and at most the maximum."""
    histogram = last - first
    if first.any() and histogram.any():
        largest_ns = min(round(bucket_edges()[np.flatnonzero(histogram)[-1] + 1]), largest_ns)
    return quantiles_us(histogram, largest_ns)
