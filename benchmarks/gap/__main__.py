"""``python -m benchmarks.gap``: hide effects, let the gap workflow find them, score it against the truth.

Every case is a recording of a device with an effect that is drawn by seed and simulated by physics of the benchmark's
own. The workflow gets the recording and the nominal model; the truth is opened when all is answered. Results are kept one
file a case: the same command goes on where it was stopped.

A seed makes nine cases. Seeds 0 to 99 are to develop on; those from 100 on are for the report and looked at once.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path

from benchmarks.gap import options, plan, processes, report, tasks
from benchmarks.gap.collect import Asked
from benchmarks.gap.hidden import LAWS
from benchmarks.report import progress as note

EXAMPLES = """\
examples:
  python -m benchmarks.gap --quick                             one seed, some cases
  python -m benchmarks.gap -o results/gap                      seeds 0 to 99: 900 cases, resumable
  python -m benchmarks.gap -o results/gap --seed 100:200       the reported ones
  python -m benchmarks.gap --only stribeck --only backlash     these effects alone
  python -m benchmarks.gap -o results/gap --report             score what is there, run nothing"""


def parse(argv: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = options.parser_of("benchmarks.gap", __doc__, Path(__file__).parent.parent / "results/gap", EXAMPLES)
    parser.add_argument("--seed", type=options.seeds, metavar="A:B", help="seeds A to B − 1, or one (default 0:100)")
    parser.add_argument("--quick", action="store_true", help="fewer cases a seed, and seed 0 alone by default")
    parser.add_argument("--only", action="append", choices=list(LAWS), metavar="EFFECT", help="repeatable")
    parser.add_argument("--kind", action="append", choices=plan.KINDS, help="repeatable; default: all")
    parser.add_argument("--device", action="append", metavar="NAME", help="repeatable; default: all")
    parser.add_argument("--most", type=int, metavar="N", help="at most so many cases, in the order of the plan")
    who = ("workflow", *report.PEERS)
    parser.add_argument("--who", action="append", choices=who, help="who answers; repeatable; default: all there are")
    chosen = parser.parse_args(argv)
    options.check(parser, chosen)
    chosen.seed = chosen.seed or (range(1) if chosen.quick else range(plan.FIRST_REPORTED_SEED))
    return chosen


def chosen_cases(asked: argparse.Namespace) -> list[plan.Case]:
    """The cases that the options ask for."""
    cases = [
        case
        for case in plan.draw(plan.QUICK if asked.quick else plan.FULL, asked.seed)
        if (asked.kind is None or case.kind in asked.kind)
        and (asked.only is None or (case.slugs and set(case.slugs) <= set(asked.only)))
        and (asked.device is None or case.device in asked.device)
    ]
    return cases[: asked.most]


def answerers(asked: argparse.Namespace) -> dict[str, Asked]:
    """Who answers.

    Raises:
        ImportError: PySINDy was asked for and is not installed.
    """
    found = {"workflow": Asked(tasks.workflow), "sindy": Asked(tasks.sindy)}
    if not importlib.util.find_spec("pysindy"):
        missing = "PySINDy is not installed: pip install 'hapticd[bench]'"
        if "sindy" in (asked.who or ()):
            raise ImportError(missing)
        if not asked.who:
            note(f"{missing}; left out")
        del found["sindy"]
    return {who: one for who, one in found.items() if who in (asked.who or found)}


def main(argv: list[str] | None = None) -> int:
    """Run, or go on; then report, as `options.answer_and_report`."""
    asked = parse(argv)
    cases = chosen_cases(asked)
    if not cases:
        note("no case is left with these options")
        return 2
    return options.answer_and_report(asked, cases, lambda: answerers(asked), report.write, "gap benchmark")


if __name__ == "__main__":
    processes.end_on_sigterm()
    sys.exit(main())
