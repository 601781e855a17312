"""Limit cycles by describing function beside exact simulation, at a few points of region B."""

from __future__ import annotations

import math

from hapticd.reproduce.items import Cell, Table
from hapticd.stability.cycle_table import Row


def table(rows: list[Row]) -> Table:
    """One row an operating point, with the errors and their reason."""
    cells: list[tuple[Cell, ...]] = []
    for row in rows:
        predicted = row.predicted
        cells.append((
            row.beta, row.sigma, predicted.amplitude if predicted else "–", row.amplitude, _percent(row.amplitude_error),
            predicted.omega if predicted else "–", row.omega, _percent(row.frequency_error), row.why or "agrees",
        ))  # fmt: skip
    header = ("β", "σ", "M predicted", "M simulated", "error", "ω predicted", "ω simulated", "error", "why")
    return Table(header, cells, "Prediction, D(M) whole, beside exact simulation from near rest; μ = 5, region B.")


def _percent(error: float) -> str:
    return f"{100.0 * error:+.1f} %" if math.isfinite(error) else "–"
