"""``python -m benchmarks.gap.late --seed 0:5``: what a late or filtered record of the current does to the names.

The cases of the benchmark with one effect hidden or none, but each row of the recording has the current of one to five
rows before; or, in every other case, what a filter of first order, with a time constant of 5 to 100 ms, has at that row.
Both are drawn by seed. Effects on the timing are left out: data tell no more than their difference from the lateness; and
behind a filter those on the input, which its record has already. Printed are how often names are right, and whether
lateness and filter are told.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from benchmarks.gap import options, tasks
from benchmarks.gap.cases import write_files
from benchmarks.gap.plan import Case, exact_class
from benchmarks.gap.rate import Rate
from benchmarks.gap.summary import STRONG
from benchmarks.report import progress

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.recording import Recording

    Floats = NDArray[np.float64]

_MOST = 5
"""Rows that a record is late at most."""
_FILTERS_S = (5e-3, 0.1)
"""Shortest and longest time constant of a filter."""


class Answered(NamedTuple):
    """One case."""

    case: Case
    effects: tuple[str, ...]
    is_filtered: bool
    true_s: float
    """Lateness or time constant, as it was made."""
    ci95_s: tuple[float, float] | None
    """As it was told, None where it was not."""


def is_tried(case: Case) -> bool:
    """Whether a case has one effect or none, and none on the timing, nor on what a filter follows."""
    from hapticd.effects.catalogue import CATALOGUE

    hidden = {CATALOGUE[slug].acts_on for slug in case.slugs}
    without = {"timing", "input"} if is_filtered(case) else {"timing"}
    return case.kind in ("none", "single") and not hidden & without


def is_filtered(case: Case) -> bool:
    """Whether the record of a case is filtered, and not late."""
    return (case.seed + case.number) % 2 == 0


def recorded(case: Case, recording: Recording) -> tuple[float, Floats]:
    """Lateness or time constant [s], and the record of the current."""
    drawn, actual = np.random.default_rng([case.seed, case.number]), recording.current
    if not is_filtered(case):
        rows = int(drawn.integers(1, _MOST, endpoint=True))
        return rows * recording.period_s, np.concatenate([np.full(rows, actual[0]), actual[:-rows]])
    filter_s = float(np.exp(drawn.uniform(*np.log(_FILTERS_S))))
    current, known = np.empty_like(actual), actual[0]
    for k, step in enumerate(np.diff(recording.time_s, append=np.inf)):
        current[k] = known
        known += (1.0 - np.exp(-step / filter_s)) * (actual[k] - known)
    return filter_s, current


def answered(case: Case) -> Answered:
    """The answer to one case whose record of the current is late or filtered."""
    from hapticd.gap import find_gap

    files, _ = tasks.make(case)
    with tempfile.TemporaryDirectory(prefix="gap-") as folder:
        write_files(Path(folder), files)
        recording, model = tasks.loaded(Path(folder))
    true_s, current = recorded(case, recording)
    found = find_gap([replace(recording, current=current, current_measured=None)], model, design=False)
    told = found.recording.get("current_filter_s" if is_filtered(case) else "current_late_s")
    return Answered(case, found.effects, is_filtered(case), true_s, tuple(told["ci95"]) if told else None)


def rows(found: list[Answered]) -> list[list[str]]:
    """Name of a rate, and the rate with and without coloured torque."""

    def is_right(one: Answered) -> bool:
        return bool(one.effects) and one.effects[0] in exact_class(one.case.slugs[0])

    single = [one for one in found if one.case.slugs]
    visible = [one for one in single if one.case.strengths[0] >= STRONG]
    none = [one for one in found if not one.case.slugs]
    judged = {
        f"first name, strength ≥ {STRONG}": [(one, is_right(one)) for one in visible],
        "a wrong first name": [(one, bool(one.effects) and not is_right(one)) for one in single],
        "wrong further names": [(one, is_right(one) and len(one.effects) > 1) for one in single],
        "nothing hidden: a name": [(one, bool(one.effects)) for one in none],
        "lateness told": [(one, one.ci95_s is not None) for one in found if not one.is_filtered],
        "filter told": [(one, one.ci95_s is not None) for one in found if one.is_filtered],
        "truth inside its 95 % interval": [
            (one, one.ci95_s[0] <= one.true_s <= one.ci95_s[1]) for one in found if one.ci95_s
        ],
    }
    lines = []
    for name, those in judged.items():
        parts = [
            [hit for one, hit in those if (one.case.coloured is not None) == coloured] for coloured in (False, True)
        ]
        lines.append([name, *(str(Rate(sum(part), len(part))) if part else "–" for part in parts)])
    return lines


def main() -> int:
    """Answer and print."""
    chosen, drawn = options.cases("benchmarks.gap.late", __doc__, range(5))
    cases = [case for case in drawn if is_tried(case)]
    found: list[Answered] = []
    with options.engine(chosen) as pool:
        for done, one in enumerate(pool.map(answered, cases), 1):
            found.append(one)
            told = "not told" if one.ci95_s is None else "told"
            hidden = ", ".join(one.case.slugs) or "nothing"
            how = "filter" if one.is_filtered else "late"
            progress(
                f"{done} of {len(cases)}: {hidden}, {1e3 * one.true_s:.2f} ms {how} ({told}): {', '.join(one.effects)}"
            )
    print(options.table(["", "without", "with coloured torque"], rows(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
