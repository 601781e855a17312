"""``python -m benchmarks.gap.residual``: how often the test of the residual cries wolf, and what it sees.

Null runs of the blind generator under the nominal model: any p value below the level is a false alarm. Runs with a hidden
effect under the nominal model, with no candidate allowed: as if the whole catalogue lacked it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.gap import plan
from benchmarks.gap.cases import write_files
from benchmarks.gap.generate import UnstableError
from benchmarks.gap.score import Rate
from benchmarks.gap.tasks import make, run_file
from benchmarks.report import progress as note


class Tested(NamedTuple):
    """One run under its nominal model."""

    case: plan.Case
    visibility: float
    gap: float
    structure: dict[str, Any]

    @property
    def surely(self) -> bool:
        """Below the level, whether or not it matters."""
        return bool(self.structure["p_value"] <= self.structure["level"])

    @property
    def matters(self) -> bool:
        """Enough to make the verdict "unexplained"."""
        return any(test["matters"] for test in self.structure["tests"])


def tested(case: plan.Case) -> Tested:
    """The test of one run's residual under the nominal model.

    Raises:
        UnstableError: the case cannot be made.
    """
    from hapticd.config import load_config
    from hapticd.gap import find_gap
    from hapticd.gap.data import load_recording

    files, truth = make(case)
    with tempfile.TemporaryDirectory(prefix="gap-") as folder:
        write_files(Path(folder), files)
        model = load_config(Path(folder) / "model.yaml")
        recording = load_recording(run_file(Path(folder)), model)
    found = find_gap([recording], model, candidates=[], design=False, workers=1).to_json()
    return Tested(case, truth["visibility"], found["gap"]["held_out"]["before"], found["residual_structure"])


def measured(cases: Sequence[plan.Case]) -> list[Tested]:
    """Every case that can be made, with a line each."""
    done = []
    for case in cases:
        try:
            one = tested(case)
        except UnstableError as error:
            note(f"left out: {error}")
            continue
        first = one.structure["tests"][0]
        largest = max(one.structure["tests"], key=lambda test: float(test["share"]))
        note(
            f"{'+'.join(case.slugs) or 'none':24} {case.strength:7} {case.device:7} visibility {one.visibility:5.2f} gap "
            f"{one.gap:5.2f}  p {first['p_value']:.4f} {first['coordinate']:15} largest share "
            f"{100 * largest['share']:4.1f} % {largest['coordinate']:15} {'matters' if one.matters else ''}"
        )
        done.append(one)
    return done


def main(argv: list[str] | None = None) -> int:
    """Print rates with their Wilson intervals."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap.residual", description=__doc__)
    parser.add_argument("--none", type=int, default=120, metavar="N", help="runs with nothing hidden (default 120)")
    parser.add_argument(
        "--seeds", type=int, default=1, metavar="N", help="runs of each effect and strength (default 1)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the whole benchmark (default 0)")
    options = parser.parse_args(argv)
    cases = plan.draw(plan.Size(seeds=options.seeds, pairs=0, none=options.none, left_out=0), options.seed)
    found = measured([case for case in cases if case.kind in ("none", "single")])
    for strength in ("none", "barely", "clear", "strong"):
        mine = [one for one in found if one.case.strength == strength]
        sure, matter = Rate(sum(o.surely for o in mine), len(mine)), Rate(sum(o.matters for o in mine), len(mine))
        print(f"{strength:7} p below the level: {sure!s:34} and it matters: {matter}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
