"""Loaders under hostile input: ``python -m benchmarks.hostile_input [--count N] [--seed S] [--loader NAME]``.

Each input is a valid file that was mutated, or a forged one: well formed, and lying. It must end in a result or in one of
the project's own errors, which names the file, within 5 s of processor time and 512 MiB. Anything else is a finding, and
the exit code is 1. ``--case N --keep FILE`` writes one input down.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

# Arrow's own allocators take their memory by the gigabyte, whatever is asked of them: here malloc tells what is needed.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")

from benchmarks.hostile import isolation
from benchmarks.hostile.loaders import LOADERS, Loader
from benchmarks.report import Figure, document, print_table, progress

QUICK = 200


def figures(reports: list[isolation.Report]) -> list[Figure]:
    """A line a loader, and the sums."""
    found = []
    for report in reports:
        ends = f"{report.accepted} accepted, {report.refused} refused"
        words = f"{report.loader}: {ends}; slowest {report.slowest_ms:.0f} ms, largest {report.largest_MiB:.0f} MiB"
        found.append(Figure(words, report.inputs, "inputs", details=isolation.document(report)))
    found.append(Figure("inputs", sum(report.inputs for report in reports), ""))
    found.append(Figure("findings", isolation.total(reports), "", goal=0))
    return found


def main(argv: list[str] | None = None) -> int:
    """Run it; 1 where something was found."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hostile_input", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=170_000, help="inputs in all, shared alike by the loaders")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--loader", action="append", choices=[loader.name for loader in LOADERS], help="default: all")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} inputs a loader")
    parser.add_argument("--case", type=int, help="one input of --loader, with its number")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="write that input down")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here instead of a table")
    options = parser.parse_args(argv)
    loaders = [loader for loader in LOADERS if options.loader is None or loader.name in options.loader]
    if options.keep is not None:
        options.keep.write_bytes(loaders[0].case(options.seed, options.case or 0))
        return 0
    each = QUICK if options.quick else max(1, options.count // len(loaders))
    reports = [_attack(loader, options.case, each, options.seed) for loader in loaders]
    found = document("hostile_input", figures(reports), options.quick)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    else:
        print_table([found])
    return 1 if isolation.total(reports) else 0


def _attack(loader: Loader, case: int | None, count: int, seed: int) -> isolation.Report:
    first, count = (0, count) if case is None else (case, 1)
    report = isolation.run(loader, first, count, seed)
    progress(f"{loader.name}: {report.inputs} inputs, {report.accepted} accepted, {report.refused} refused")
    for what, finding in report.findings.items():
        progress(f"  FINDING {what} ({finding.count} times, first in case {finding.case}): {finding.words}")
    return report


if __name__ == "__main__":
    sys.exit(main())
