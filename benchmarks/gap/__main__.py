"""``python -m benchmarks.gap``: hide effects, let the gap workflow find them, score it against the truth.

Every case is a recording of a device with an effect that is drawn by seed and simulated by physics of the benchmark's
own. The workflow gets the recording and the nominal model; the truth is opened when all is answered. Results are kept one
file a case: the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

from benchmarks.gap import collect, plan, report
from benchmarks.gap.hidden import LAWS
from benchmarks.gap.recipes import VISIBILITY
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
        "  python -m benchmarks.gap --quick                          one case of each kind: minutes\n"
        "  python -m benchmarks.gap -o results/gap                   all of it: hours, resumable\n"
        "  python -m benchmarks.gap --only stribeck --only backlash  these effects alone\n"
        "  python -m benchmarks.gap -o results/gap --report          score what is there, run nothing",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", default=Path(__file__).parent.parent / "results/gap"
    )
    parser.add_argument("--quick", action="store_true", help="one case of each effect and strength, few of the others")
    parser.add_argument("--only", action="append", choices=list(LAWS), metavar="EFFECT", help="repeatable")
    parser.add_argument("--kind", action="append", choices=plan.KINDS, help="repeatable; default: all")
    parser.add_argument("--strength", action="append", choices=list(VISIBILITY), help="repeatable; default: all")
    parser.add_argument("--device", action="append", metavar="NAME", help="repeatable; default: all")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the whole benchmark (default 0)")
    parser.add_argument("--seeds", type=int, metavar="N", help="cases of each effect and strength (default 4)")
    parser.add_argument("--most", type=int, metavar="N", help="at most so many cases, in the order of the plan")
    parser.add_argument("--who", action="append", choices=list(collect.ANSWERERS), help="repeatable; default: both")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N", help="processes")
    parser.add_argument("--dask", metavar="ADDRESS", help="run on this Dask cluster instead, e.g. tcp://host:8786")
    parser.add_argument("--report", action="store_true", help="score what is there and run nothing")
    options = parser.parse_args(argv)
    if options.jobs < 1 or (options.seeds is not None and options.seeds < 1):
        parser.error("--jobs and --seeds: at least 1")
    return options


def chosen(options: argparse.Namespace) -> list[plan.Case]:
    """The cases that the options ask for."""
    size = plan.QUICK if options.quick else plan.FULL
    if options.seeds is not None:
        size = replace(size, seeds=options.seeds)
    cases = [
        case
        for case in plan.draw(size, options.seed)
        if (options.kind is None or case.kind in options.kind)
        and (options.only is None or (case.slugs and set(case.slugs) <= set(options.only)))
        and (options.strength is None or case.strength in options.strength)
        and (options.device is None or case.device in options.device)
    ]
    return cases[: options.most]


def main(argv: list[str] | None = None) -> int:
    """Run, or go on; then report. 1 when there is nothing to report, 2 when the cluster cannot be used."""
    options = parse(argv)
    cases = chosen(options)
    if not cases:
        note("no case is left with these options")
        return 2
    root = options.output
    root.mkdir(parents=True, exist_ok=True)
    code = 0
    if not options.report:
        who = options.who or list(collect.ANSWERERS)
        store = collect.Store(root)
        engine = collect.dask(options.dask) if options.dask else collect.local(options.jobs)
        try:
            with engine as pool, progress_bar("gap benchmark") as advance:
                collect.run(cases, store, who, pool, options.jobs, advance, note)
        except KeyboardInterrupt:
            note(f"{root} keeps what is finished; the same command goes on from there")
            code = INTERRUPTED
        except collect.ClusterError as error:
            note(str(error))
            return 2
    try:
        print(report.write(root, len(cases)))
    except FileNotFoundError as error:
        note(str(error))
        return code or 1
    return code


if __name__ == "__main__":
    sys.exit(main())
