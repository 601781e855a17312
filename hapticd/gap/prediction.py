"""The check that a person believes: predictions from the recorded command alone, over a horizon and over a whole record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.plant.electrical import electrical
from hapticd.plant.layout import BRISTLE, CONTACT, LOAD_OMEGA, LOAD_THETA, OMEGA, STATE, THETA
from hapticd.plant.numeric import simulate_windows_serial
from hapticd.plant.resolution import substeps_for

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.fit import Fit

    Floats = NDArray[np.float64]

HORIZON_S = 0.05


def prediction_errors(before: Fit, after: Fit, is_linear: bool) -> dict[str, Any]:
    """RMS errors of position, rad or m, by both models.

    Returns:
        ``horizon_s``; ``k_step`` (from the filtered state, that long ahead) and ``free_run`` (from the first state of each
        recording to its end), ``before`` and ``after`` each; ``unit``.
    """
    found = {name: _errors(fit) for name, fit in (("before", before), ("after", after))}
    return {
        "horizon_s": HORIZON_S,
        "k_step": {name: errors[0] for name, errors in found.items()},
        "free_run": {name: errors[1] for name, errors in found.items()},
        "unit": "m" if is_linear else "rad",
    }


def _errors(fit: Fit) -> tuple[float, float]:
    series, p = fit.problem.series, fit.device()
    near, free = [], []
    for number in range(int(series.recording[-1]) + 1):
        rows = np.flatnonzero(series.recording == number)
        part = slice(rows[0], rows[-1] + 1)
        time_s, position = series.time_s[part], (series.cell[part] + 0.5) * series.resolution
        substeps = max(substeps_for(p, series.period_s), 2)
        current = np.empty((rows.size, substeps))
        electrical(p, time_s, series.command[part].copy(), np.zeros(rows.size, dtype=np.uint8), substeps, current)
        steps = max(round(HORIZON_S / series.period_s), 1)
        starts = np.arange(0, rows.size - steps - 1, steps)
        shown = position[starts[:, None] + 1 + np.arange(steps)]
        near.append(_predicted(fit, part, time_s, current, starts, steps, p) - shown)
        begin = np.array([min(steps, rows.size - 2)])
        length = int(rows.size - 1 - begin[0])
        free.append((_predicted(fit, part, time_s, current, begin, length, p) - position[begin[0] + 1 :])[0])
    return float(np.sqrt(np.mean(np.concatenate([e[:, -1] for e in near]) ** 2))), float(
        np.sqrt(np.mean(np.concatenate(free) ** 2))
    )


def _predicted(
    fit: Fit, part: slice, time_s: Floats, current: Floats, starts: NDArray[np.int64], length: int, p: Floats
) -> Floats:
    rows = fit.out[part][starts]
    state = np.zeros((starts.size, STATE))
    state[:, THETA], state[:, OMEGA], state[:, BRISTLE] = rows["x"], rows["v"], rows["bristle"]
    state[:, LOAD_THETA], state[:, LOAD_OMEGA], state[:, CONTACT] = rows["load_x"], rows["load_v"], rows["contact"]
    position, end = np.empty((starts.size, length)), np.empty((starts.size, STATE))
    simulate_windows_serial(p, time_s, current, starts, length, state, position, end)
    return position
