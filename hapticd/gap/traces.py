"""Window by window, what the report draws: the gap over time before and after, and some windows in full."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.search import Data, Judged

    Floats = NDArray[np.float64]

_SHOWN = 3


@dataclass(frozen=True)
class Excerpt:
    """One window: time from its start in s; positions from the first sample, rad or m."""

    start_s: float
    time_s: Floats
    observed: Floats
    before: Floats
    after: Floats


@dataclass(frozen=True)
class Trace:
    """One recording in windows (w,)."""

    name: str
    time_s: Floats
    """Middle of each window."""
    speed: Floats
    """Mean absolute smoothed velocity, rad/s or m/s."""
    before: Floats
    """RMS held-out prediction error over the noise floor."""
    after: Floats
    excerpts: tuple[Excerpt, ...]
    """The windows that gained most."""


def traces_of(data: Data, nominal: Judged, final: Judged, floor: float) -> tuple[Trace, ...]:
    """Traces of all recordings.

    Args:
        data: the windows. nominal, final: the model as given and as improved.
        floor: RMS prediction error that noise alone leaves, rad or m.
    """
    traces, first = [], 0
    for number, segment in enumerate(data.segments):
        rows = slice(first, first + segment.count)
        first += segment.count
        before, after = (np.sqrt(j.held_out.mean_square[rows]) * segment.sigma / floor for j in (nominal, final))
        ticks = segment.windows.rows
        time_s = segment.recording.time_s
        gain = before**2 - after**2
        chosen = np.sort(np.argsort(gain)[::-1][:_SHOWN])
        excerpts = []
        for window in chosen:
            observed = segment.observed[window]
            errors = [j.fit.residuals[number][window] * segment.sigma[window] for j in (nominal, final)]
            times = time_s[ticks[window]]
            excerpts.append(
                Excerpt(
                    float(times[0]),
                    times - times[0],
                    observed - observed[0],
                    observed - errors[0] - observed[0],
                    observed - errors[1] - observed[0],
                )
            )
        traces.append(
            Trace(
                segment.recording.name,
                time_s[ticks].mean(axis=1),
                np.abs(segment.velocity[ticks]).mean(axis=1),
                before,
                after,
                tuple(excerpts),
            )
        )
    return tuple(traces)
