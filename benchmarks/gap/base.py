"""``python -m benchmarks.gap.base --seed 0:20``: are inertia and friction right beside a torque that no catalogue knows?

The cases of the benchmark with nothing hidden. The three base parameters are fitted beside the disturbance, from the truth;
printed are their mean error, the same in standard errors, and how many 95 % intervals hold the truth.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from benchmarks.gap import options, tasks
from benchmarks.gap.cases import write_files
from benchmarks.gap.plan import Case
from benchmarks.gap.rate import Rate
from benchmarks.report import progress


class Fitted(NamedTuple):
    """One base parameter in one case."""

    name: str
    coloured: bool
    error: float
    """Relative."""
    deviation: float
    """Its standard error."""
    inside: bool


def fitted(case: Case) -> list[Fitted]:
    """The base parameters of one case."""
    from hapticd.gap.base_model import base_law, problem_of
    from hapticd.gap.covariance import covariance_of
    from hapticd.gap.nominal import nominal_fit
    from hapticd.gap.terms import BASE_WORDS

    files, _ = tasks.make(case)
    with tempfile.TemporaryDirectory(prefix="gap-") as folder:
        write_files(Path(folder), files)
        recording, model = tasks.loaded(Path(folder))
    problem = problem_of([recording], model).with_slow_disturbance()
    fit = nominal_fit(problem, [base_law(problem, slug) for slug in BASE_WORDS])
    fit.held_out()
    reach = float(student.isf(0.025, problem.series.blocks - 1))
    variance = np.diag(covariance_of(fit))
    found = []
    for number, item in enumerate(fit.terms):
        at = fit.columns(number).start
        error, deviation = float(fit.u[at] - item.coordinates[0].centre), math.sqrt(variance[at])
        inside = abs(error) < reach * deviation
        found.append(Fitted(BASE_WORDS[item.slug], case.coloured is not None, error, deviation, inside))
    return found


def rows(found: list[Fitted]) -> list[list[str]]:
    """A line for each parameter, with and without coloured torque."""
    lines = []
    for coloured in (False, True):
        for name in dict.fromkeys(one.name for one in found):
            those = [one for one in found if one.name == name and one.coloured == coloured]
            if those:
                held = Rate(sum(one.inside for one in those), len(those))
                scores = [one.error / one.deviation for one in those]
                lines.append(
                    [
                        "with coloured torque" if coloured else "without",
                        name,
                        f"{100.0 * np.mean([one.error for one in those]):+.2f} %",
                        f"{np.mean(scores):+.2f}",
                        f"{np.sqrt(np.mean(np.square(scores))):.2f}",
                        str(held),
                    ]
                )
    return lines


def main() -> int:
    """Fit and print."""
    chosen, drawn = options.cases("benchmarks.gap.base", __doc__, range(10))
    cases = [case for case in drawn if case.kind == "none"]
    found: list[Fitted] = []
    with options.engine(chosen) as pool:
        for done, parameters in enumerate(pool.map(fitted, cases), 1):
            found += parameters
            progress(f"{done} of {len(cases)} cases")
    head = ["", "parameter", "mean error", "in standard errors", "their RMS", "truth inside 95 %"]
    print(options.table(head, rows(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
