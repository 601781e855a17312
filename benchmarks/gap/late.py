"""``python -m benchmarks.gap.late --seed 0:5``: what a late record of the current does to the names.

The cases of the benchmark with one effect hidden or none, but each row of the recording has the current of one to five
rows before, drawn by seed. Effects on the timing are left out: data tell no more than their difference from the lateness.
Printed are how often names are right, and whether the lateness is told.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.gap import options, tasks
from benchmarks.gap.cases import write_files
from benchmarks.gap.plan import Case, exact_class
from benchmarks.gap.rate import Rate
from benchmarks.gap.summary import STRONG
from benchmarks.report import progress

_MOST = 5
"""Rows that a record is late at most."""


class Answered(NamedTuple):
    """One case."""

    case: Case
    effects: tuple[str, ...]
    late_s: float
    """As it was made."""
    ci95_s: tuple[float, float] | None
    """As it was told, None where it was not."""


def is_tried(case: Case) -> bool:
    """Whether a case has one effect or none, and none on the timing."""
    from hapticd.effects.catalogue import CATALOGUE

    return case.kind in ("none", "single") and all(CATALOGUE[slug].acts_on != "timing" for slug in case.slugs)


def answered(case: Case) -> Answered:
    """The answer to one case whose record of the current is late."""
    from hapticd.gap import find_gap

    files, _ = tasks.make(case)
    with tempfile.TemporaryDirectory(prefix="gap-") as folder:
        write_files(Path(folder), files)
        recording, model = tasks.loaded(Path(folder))
    late = int(np.random.default_rng([case.seed, case.number]).integers(1, _MOST, endpoint=True))
    current = np.concatenate([np.full(late, recording.current[0]), recording.current[:-late]])
    found = find_gap([replace(recording, current=current, current_measured=None)], model, design=False)
    told = found.recording.get("current_late_s")
    return Answered(case, found.effects, late * recording.period_s, tuple(told["ci95"]) if told else None)


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
        "lateness told": [(one, one.ci95_s is not None) for one in found],
        "truth inside its 95 % interval": [
            (one, one.ci95_s[0] <= one.late_s <= one.ci95_s[1]) for one in found if one.ci95_s
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
            progress(
                f"{done} of {len(cases)}: {hidden}, {1e3 * one.late_s:.2f} ms late ({told}): {', '.join(one.effects)}"
            )
    print(options.table(["", "without", "with coloured torque"], rows(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
