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

    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit

HORIZON_S = 0.05


def prediction_errors(before: Fit, after: Fit, is_linear: bool) -> dict[str, Any]:
    """RMS errors of position, rad or m, by both models.

    Returns:
        ``horizon_s``; ``k_step`` (from the filtered state, that long ahead) and ``free_run`` (from the state so long after
        the first sample of each stretch without a gap, to its end), ``before`` and ``after`` each; ``unit``. Nothing where
        no stretch is that long.
    """
    of_before, of_after = _errors(before), _errors(after)
    if of_before is None or of_after is None:
        return {}
    found = {"before": of_before, "after": of_after}
    return {
        "horizon_s": HORIZON_S,
        "k_step": {name: errors[0] for name, errors in found.items()},
        "free_run": {name: errors[1] for name, errors in found.items()},
        "unit": "m" if is_linear else "rad",
    }


def _errors(fit: Fit) -> tuple[float, float] | None:
    series, p = fit.problem.series, fit.device()
    commands = series.commands(fit.filter_s())
    near, free = [], []
    first = np.flatnonzero(series.begins).tolist()
    for begin, end in zip(first, [*first[1:], series.size], strict=True):
        part, size = slice(begin, end), end - begin
        time_s, position = series.time_s[part], (series.cell[part] + 0.5) * series.resolution
        period_s = float(np.median(np.diff(time_s))) if size > 1 else HORIZON_S
        steps = max(round(HORIZON_S / period_s), 1)
        if size < steps + 3:
            continue
        current = np.empty((size, max(substeps_for(p, period_s), 2)))
        electrical(p, time_s, commands[part].copy(), np.zeros(size, dtype=np.uint8), current.shape[1], current)
        starts = np.arange(0, size - steps - 1, steps)
        near.append(_predicted(fit, part, time_s, current, starts, steps, p)[:, -1] - position[starts + steps])
        whole = _predicted(fit, part, time_s, current, starts[:1] + steps, size - 1 - steps, p)
        free.append(whole[0] - position[steps + 1 :])
    if not near:
        return None
    of_near, of_free = (float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) for errors in (near, free))
    return of_near, of_free


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
