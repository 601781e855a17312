"""Predictions from the recorded command alone: over a short horizon, and over a whole record (free run)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.plant.electrical import electrical
from hapticd.plant.layout import BRISTLE, CONTACT, LOAD_OMEGA, LOAD_THETA, OMEGA, STATE, THETA
from hapticd.plant.numeric import simulate_windows_serial
from hapticd.plant.resolution import substeps_for

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.series import Series

HORIZON_S = 0.05


@dataclass(frozen=True)
class Prediction:
    """Positions at n samples, rad or m; NaN where nothing is predicted, infinite where the prediction overflows.

    A stretch is a part of a recording without missing samples.

    Attributes:
        time_s: (n,) from the start of each recording. begins: (n,) whether a stretch begins. measured: (n,).
        k_step: (n,) at the end of each horizon, from the filtered state at its start. The first horizon of a stretch starts
            `HORIZON_S` after its first sample.
        free_run: (n,) from that first state to the end of the stretch.
    """

    time_s: Floats
    begins: NDArray[np.bool_]
    measured: Floats
    k_step: Floats
    free_run: Floats


def predicted(fit: Fit) -> Prediction | None:
    """Predictions of a model for the samples of its fit; None if no stretch is long enough."""
    series, p = fit.problem.series, fit.device()
    commands = series.commands(fit.filter_s())
    measured = (series.cell + 0.5) * series.resolution
    k_step, free_run = np.full(series.size, np.nan), np.full(series.size, np.nan)
    for part, period_s, steps in stretches(series):
        time_s, size = series.time_s[part], part.stop - part.start
        current = np.empty((size, max(substeps_for(p, period_s), 2)))
        electrical(p, time_s, commands[part].copy(), np.zeros(size, dtype=np.uint8), current.shape[1], current)
        current += series.added[part, None]
        starts = np.arange(steps, size - steps - 1, steps)  # at the first sample the speed is unknown
        near = _positions(fit, part, time_s, current, starts, steps, p)
        k_step[part.start + starts + steps] = np.where(np.isnan(near[:, -1]), np.inf, near[:, -1])
        whole = _positions(fit, part, time_s, current, starts[:1], size - 1 - steps, p)
        free_run[part.start + steps + 1 : part.stop] = np.where(np.isnan(whole[0]), np.inf, whole[0])
    return Prediction(series.time_s, series.begins, measured, k_step, free_run) if not np.isnan(k_step).all() else None


def stretches(series: Series) -> Iterator[tuple[slice, float, int]]:
    """Rows, median period [s], and samples per horizon, of each stretch that is long enough for a prediction."""
    first = np.flatnonzero(series.begins).tolist()
    for begin, end in zip(first, [*first[1:], series.size], strict=True):
        period_s = float(np.median(np.diff(series.time_s[begin:end]))) if end - begin > 1 else HORIZON_S
        steps = max(round(HORIZON_S / period_s), 1)
        if end - begin > 2 * steps + 1:
            yield slice(begin, end), period_s, steps


def prediction_errors(before: Prediction | None, after: Prediction | None, is_linear: bool) -> dict[str, Any]:
    """RMS errors of position, rad or m, by both models.

    Returns:
        ``horizon_s``; ``k_step`` and ``free_run`` (see `Prediction`), ``before`` and ``after`` each, with ``unit`` and
        ``fit_percent``: 100 (1 − ‖e‖ / ‖x − mean‖), over the same samples; ``unit``. Empty if nothing is predicted.
    """
    if before is None or after is None:
        return {}
    unit = "m" if is_linear else "rad"
    found: dict[str, Any] = {"horizon_s": HORIZON_S, "unit": unit}
    for name in ("k_step", "free_run"):
        errors = {"before": _error(before, name), "after": _error(after, name)}
        found[name] = {
            **{when: rms for when, (rms, _) in errors.items()},
            "unit": unit,
            "fit_percent": {when: fit for when, (_, fit) in errors.items()},
        }
    return found


def _error(of: Prediction, name: str) -> tuple[float, float | None]:
    """RMS error, and the fit in percent; that is None without motion, or if the prediction overflows."""
    positions: Floats = getattr(of, name)
    known = ~np.isnan(positions)
    with np.errstate(over="ignore"):
        rms = float(np.sqrt(np.mean((positions - of.measured)[known] ** 2)))
    spread = float(np.std(of.measured[known]))
    return rms, 100.0 * (1.0 - rms / spread) if spread > 0.0 and np.isfinite(rms) else None


def _positions(
    fit: Fit, part: slice, time_s: Floats, current: Floats, starts: NDArray[np.int64], length: int, p: Floats
) -> Floats:
    rows = fit.out[part][starts]
    state = np.zeros((starts.size, STATE))
    state[:, THETA], state[:, OMEGA], state[:, BRISTLE] = rows["x"], rows["v"], rows["bristle"]
    state[:, LOAD_THETA], state[:, LOAD_OMEGA], state[:, CONTACT] = rows["load_x"], rows["load_v"], rows["contact"]
    position, end = np.empty((starts.size, length)), np.empty((starts.size, STATE))
    simulate_windows_serial(p, time_s, current, starts, length, state, position, end)
    return position
