"""``python -m benchmarks.gap.foreign``: machines of other people, in other people's files; see the package's first lines.

Results are kept one file a case: the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.gap import options, processes
from benchmarks.gap.collect import Asked
from benchmarks.gap.foreign import cases, record, table


def parse(argv: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = options.parser_of("benchmarks.gap.foreign", __doc__, Path(__file__).parents[2] / "results/gap_foreign")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default 0")
    parser.add_argument("--cases", type=int, default=120, metavar="N", help="the first N of the seed (default 120)")
    parser.add_argument(
        "--fault",
        action="append",
        choices=[*record.FAULTS],
        metavar="FAULT",
        help=f"repeatable: {', '.join(record.FAULTS)}",
    )
    chosen = parser.parse_args(argv)
    options.check(parser, chosen)
    if chosen.seed < 0 or chosen.cases < 1:
        parser.error("--seed: at least 0; --cases: at least 1")
    return chosen


def main(argv: list[str] | None = None) -> int:
    """Run, or go on; then report, as `options.answer_and_report`."""
    asked = parse(argv)
    wanted = [
        case
        for case in (cases.Case(asked.seed, number) for number in range(asked.cases))
        if not asked.fault or case.drawn[2] in asked.fault
    ]
    who = {table.WHO: Asked(cases.answer)}
    return options.answer_and_report(asked, wanted, lambda: who, table.write, "foreign records", cases.make)


if __name__ == "__main__":
    processes.end_on_sigterm()
    sys.exit(main())
