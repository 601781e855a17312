"""The describing function against exact simulation over regions B and C: how many starts end in the cycle that it names.

The whole table, with the cycles in which starts end, goes to ``cycles.csv`` beside the JSON results.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.report import Figure, progress
from hapticd.stability.cycles import within
from hapticd.stability.describing_function import (
    AMPLITUDE_TOLERANCE,
    FREQUENCY_TOLERANCE,
    LimitCycle,
    predicted_cycle,
)
from hapticd.stability.explore import Effort, explore_loop
from hapticd.stability.explored import Explored
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.regions import region
from hapticd.stability.whole_loop import bare_loop

TABLE = Path(__file__).parent / "results" / "cycles.csv"
MU: Final = 100.0
DELAYS: Final = (0.0, 0.25, 1.25)
BETAS: Final = (0.1, 0.2, 0.3, 0.4, 0.45, 0.55, 0.65, 0.75, 0.9, 1.05, 1.2, 1.5)
"""At every delay so much less than τ_D, so that both regions are covered."""
SIGMAS: Final = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45)
#: Energy of the fastest starts, as ticks at rest.
REACH: Final = 3.0


@dataclass(frozen=True)
class Row:
    """An operating point, what is predicted of it (None: growth without bound), and what starts end in."""

    numbers: Dimensionless
    predicted: LimitCycle | None
    explored: Explored

    @property
    def amplitude_met(self) -> float:
        """Share of the starts within 15 % of the predicted amplitude."""
        return within(self.explored.cycles, self.predicted.amplitude, AMPLITUDE_TOLERANCE) if self.predicted else 0.0

    @property
    def frequency_met(self) -> float:
        """Share of the starts within 10 % of the predicted frequency."""
        if self.predicted is None:
            return 0.0
        swings = self.predicted.omega / (2.0 * np.pi)
        cycles = [cycle for cycle in self.explored.cycles if cycle.periods]
        return sum(cycle.share for cycle in cycles if abs(swings * cycle.periods - 1.0) <= FREQUENCY_TOLERANCE)

    def share(self, kind: str) -> float:
        """Share of the starts that end in cycles of a kind."""
        return sum(cycle.share for cycle in self.explored.cycles if cycle.kind == kind)


def table(
    betas: Sequence[float] = BETAS,
    sigmas: Sequence[float] = SIGMAS,
    delays: Sequence[float] = DELAYS,
    starts: int = 256,
) -> list[Row]:
    """One row for each operating point."""
    effort = Effort(starts, 3_000_000, 40_000)
    rows = []
    for n in (Dimensionless(MU, b + tau_d, s, tau_d) for tau_d in delays for b in betas for s in sigmas):
        explored = explore_loop(bare_loop(n), REACH, effort=effort, jobs=None)
        rows.append(Row(n, predicted_cycle(n), explored))
    return rows


def _write(rows: Sequence[Row]) -> None:
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    with TABLE.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ("tau_d", "beta", "sigma", "region", "predicted", "amplitude_met", "frequency_met", "largest", "ends")
        )
        for row in rows:
            n, predicted = row.numbers, row.predicted
            ends = "; ".join(f"{share:.3f} {name}" for share, name, _ in row.explored.ends)
            writer.writerow((
                n.tau_d, n.beta, n.sigma, region(n), predicted.amplitude if predicted else "", row.amplitude_met,
                row.frequency_met, row.explored.largest_cycle, ends,
            ))  # fmt: skip
    progress(f"{len(rows)} rows in {TABLE}")


def measure(quick: bool) -> list[Figure]:
    """Shares of the starts within 15 % in amplitude and 10 % in frequency, and in cycles of each kind, region by region."""
    rows = table(BETAS[::4], SIGMAS[::3], starts=32) if quick else table()
    _write(rows)
    figures = []
    for name in ("B", "C"):
        inside = [row for row in rows if region(row.numbers) == name]
        peer = f"exact simulation, {len(inside)} points of {name}"
        # The goal is region B's; C mostly grows, and there is no claim about the rest of it.
        goal = 100.0 if name == "B" else None
        amplitude, frequency = (
            np.mean([getattr(row, what) for row in inside]) for what in ("amplitude_met", "frequency_met")
        )
        figures += [
            Figure("starts with amplitude within 15 %", 100.0 * float(amplitude), "%", goal, "≥", peer),
            Figure("starts with frequency within 10 %", 100.0 * float(frequency), "%", goal, "≥", peer),
        ]
        for kind in ("symmetric", "asymmetric", "wandering"):
            share = float(np.mean([row.share(kind) for row in inside]))
            figures.append(Figure(f"starts in {kind} cycles", 100.0 * share, "%", peer=peer))
    return figures
