"""A run in a few numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticd.record.reader import Run, median_period
from hapticd.record.schema import FLAG_MISSED_PERIOD


def summary(run: Run) -> dict[str, Any]:
    """Duration, rows and timing of a run.

    Returns:
        ``rows``; ``duration_s`` (first to last row); ``rate_hz`` (1 / median period; None below two rows); ``missed``
        (ticks before which periods were skipped); ``lost_rows`` (gaps in ``tick`` that no skipped period explains);
        ``wake_late_ns`` with ``p50 p99 max``; the last three are None where the run lacks their columns.
    """
    time_s, columns = run.columns["time_s"], run.columns
    period = median_period(time_s)
    result: dict[str, Any] = {
        "rows": run.rows,
        "duration_s": float(time_s[-1]) - float(time_s[0]) if run.rows else 0.0,
        "rate_hz": 1.0 / period if period > 0.0 else None,
        "missed": None,
        "lost_rows": None,
        "wake_late_ns": None,
    }
    if "flags" in columns:
        skipped = (columns["flags"] & FLAG_MISSED_PERIOD) != 0
        result["missed"] = int(np.count_nonzero(skipped))
        if "tick" in columns:
            result["lost_rows"] = int(np.sum((np.diff(columns["tick"]) - 1)[~skipped[1:]]))
    if "wake_late_ns" in columns and run.rows:
        late = columns["wake_late_ns"]
        p50, p99 = np.percentile(late, [50, 99])
        result["wake_late_ns"] = {"p50": float(p50), "p99": float(p99), "max": int(late.max())}
    return result
