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
from functools import partial
from pathlib import Path

from benchmarks.gap import before, collect, options, plan, processes, report, tasks
from benchmarks.gap.collect import Asked
from benchmarks.gap.hidden import LAWS
from benchmarks.report import progress as note
from hapticd.cli.output import progress_bar

INTERRUPTED = 130


def parse(argv: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.gap",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="examples:\n"
        "  python -m benchmarks.gap --quick                             one seed, some cases\n"
        "  python -m benchmarks.gap -o results/gap                      seeds 0 to 99: 900 cases, resumable\n"
        "  python -m benchmarks.gap -o results/gap --seed 100:200       the reported ones\n"
        "  python -m benchmarks.gap --only stribeck --only backlash     these effects alone\n"
        "  python -m benchmarks.gap -o results/gap --report             score what is there, run nothing",
    )
    options.add_common(parser, Path(__file__).parent.parent / "results/gap")
    parser.add_argument("--seed", type=options.seeds, metavar="A:B", help="seeds A to B − 1, or one (default 0:100)")
    parser.add_argument("--quick", action="store_true", help="fewer cases a seed, and seed 0 alone by default")
    parser.add_argument("--only", action="append", choices=list(LAWS), metavar="EFFECT", help="repeatable")
    parser.add_argument("--kind", action="append", choices=plan.KINDS, help="repeatable; default: all")
    parser.add_argument("--device", action="append", metavar="NAME", help="repeatable; default: all")
    parser.add_argument("--most", type=int, metavar="N", help="at most so many cases, in the order of the plan")
    parser.add_argument(
        "--who",
        action="append",
        choices=("workflow", *report.PEERS),
        help="who answers; repeatable; default: all there are",
    )
    parser.add_argument(
        "--before-most",
        type=int,
        default=100,
        metavar="N",
        help=f"at most so many cases for the core before, up to {before.LIMIT_S:g} s of a processor each (default 100)",
    )
    parser.add_argument("--report", action="store_true", help="score what is there and run nothing")
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
        NoHistoryError: the core before was asked for and cannot be had.
        ImportError: PySINDy was asked for and is not installed.
    """
    found = {}
    for who in asked.who or ("workflow", *report.PEERS):
        if who == "workflow":
            found[who] = Asked(tasks.workflow)
        elif who == "sindy" and importlib.util.find_spec("pysindy"):
            found[who] = Asked(tasks.sindy)
        elif who == "sindy":
            missing = "PySINDy is not installed: pip install 'hapticd[bench]'"
            if asked.who:
                raise ImportError(missing)
            note(f"{missing}; left out")
        else:
            found[who] = Asked(partial(before.answer, tree=before.prepared(asked.output)), asked.before_most)
    return found


def main(argv: list[str] | None = None) -> int:
    """Run, or go on; then report. 1 when there is nothing to report, 2 when what was asked for cannot be used."""
    asked = parse(argv)
    cases = chosen_cases(asked)
    if not cases:
        note("no case is left with these options")
        return 2
    root = asked.output
    root.mkdir(parents=True, exist_ok=True)
    code = 0
    if not asked.report:
        try:
            who = answerers(asked)
            with options.engine(asked) as pool, progress_bar("gap benchmark") as advance:
                collect.run(cases, collect.Store(root), who, pool, asked.jobs, advance, note)
        except KeyboardInterrupt:
            note(f"{root} keeps what is finished; the same command goes on from there")
            code = INTERRUPTED
        except (collect.ClusterError, before.NoHistoryError, ImportError) as error:
            note(str(error))
            return 2
    try:
        print(report.write(root, cases))
    except FileNotFoundError as error:
        note(str(error))
        return code or 1
    return code


if __name__ == "__main__":
    processes.end_on_sigterm()
    sys.exit(main())
