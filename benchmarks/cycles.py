"""The describing function against exact simulation over regions B and C: how often its amplitude and frequency are right.

The whole table, with the reason in every row that is off, goes to ``cycles.csv`` beside the JSON results.
"""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from benchmarks.report import Figure, progress, run_alone
from hapticd.stability.cycle_table import AMPLITUDE_TOLERANCE, FREQUENCY_TOLERANCE, Row, cycle_table

TABLE = Path(__file__).parent / "results" / "cycles.csv"


@dataclass(frozen=True)
class Summary:
    """How a region fares.

    Attributes:
        points: rows of the region.
        oscillating: rows where both prediction and simulation oscillate.
        amplitude_within: share of these with an amplitude error within 15 %.
        frequency_within: share of these with a frequency error within 10 %.
        agree: rows that agree.
        locked: oscillating rows that are on an exact cycle.
        median_amplitude_error: median of the absolute amplitude error.
        median_frequency_error: median of the absolute frequency error.
    """

    points: int
    oscillating: int
    amplitude_within: float
    frequency_within: float
    agree: int
    locked: int
    median_amplitude_error: float
    median_frequency_error: float


def summarise(rows: Sequence[Row], name: str) -> Summary:
    """Count the rows of one region."""
    inside = [row for row in rows if row.region == name]
    errors = np.array([(r.amplitude_error, r.frequency_error) for r in inside if math.isfinite(r.amplitude_error)])
    errors = np.abs(errors.reshape(-1, 2))
    share = errors <= (AMPLITUDE_TOLERANCE, FREQUENCY_TOLERANCE)
    median = np.median(errors, axis=0) if len(errors) else (math.nan, math.nan)
    within = share.mean(axis=0) if len(errors) else (math.nan, math.nan)
    return Summary(
        points=len(inside),
        oscillating=len(errors),
        amplitude_within=float(within[0]),
        frequency_within=float(within[1]),
        agree=sum(row.agrees for row in inside),
        locked=sum(row.locked is not None for row in inside),
        median_amplitude_error=float(median[0]),
        median_frequency_error=float(median[1]),
    )


def _write(rows: list[Row]) -> None:
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    names = [field.name for field in fields(Row) if field.name not in ("predicted", "locked")]
    with TABLE.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*names, "predicted_amplitude", "predicted_omega", "locked_half_period"])
        for row in rows:
            cycle = row.predicted
            found = (cycle.amplitude, cycle.omega) if cycle is not None else (math.nan, math.nan)
            on_cycle = round(math.pi / row.locked.omega) if row.locked is not None else ""
            writer.writerow([*(getattr(row, name) for name in names), *found, on_cycle])
    progress(f"{len(rows)} rows in {TABLE}")


def measure(quick: bool) -> list[Figure]:
    """Shares within 15 % in amplitude and 10 % in frequency, region by region."""
    rows = cycle_table(periods=10_000 if quick else 60_000)
    _write(rows)
    figures = []
    for name in ("B", "C"):
        found = summarise(rows, name)
        peer = f"exact simulation, {found.oscillating} oscillating points of {name}"
        # The goal is region B's; C mostly grows, and there is no claim about the rest of it.
        goal = 100.0 if name == "B" else None
        figures += [
            Figure("amplitude within 15 %", 100.0 * found.amplitude_within, "%", goal, "≥", peer),
            Figure("frequency within 10 %", 100.0 * found.frequency_within, "%", goal, "≥", peer),
            Figure("median error of amplitude", 100.0 * found.median_amplitude_error, "%", peer=peer),
            Figure("median error of frequency", 100.0 * found.median_frequency_error, "%", peer=peer),
            Figure("points on an exact locked cycle", found.locked, "", peer=peer),
        ]
    return figures


def main(argv: list[str] | None = None) -> int:
    """Run this benchmark alone."""
    return run_alone("cycles", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
