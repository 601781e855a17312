"""``python -m benchmarks.gap.foreign``: machines of other people, in other people's files; see the package's first lines.

Results are kept one file a case: the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.gap import collect, options, processes
from benchmarks.gap.collect import Asked
from benchmarks.gap.foreign import cases, table
from benchmarks.report import progress as note
from hapticd.cli.output import progress_bar

INTERRUPTED = 130


def parse(argv: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.gap.foreign",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options.add_common(parser, Path(__file__).parents[2] / "results/gap_foreign")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default 0")
    parser.add_argument("--cases", type=int, default=120, metavar="N", help="the first N of the seed (default 120)")
    parser.add_argument("--report", action="store_true", help="score what is there and run nothing")
    chosen = parser.parse_args(argv)
    options.check(parser, chosen)
    if chosen.seed < 0 or chosen.cases < 1:
        parser.error("--seed: at least 0; --cases: at least 1")
    return chosen


def main(argv: list[str] | None = None) -> int:
    """Run, or go on; then report. 1 when there is nothing to report, 2 when what was asked for cannot be used."""
    asked = parse(argv)
    root, code = asked.output, 0
    wanted = [cases.Case(asked.seed, number) for number in range(asked.cases)]
    root.mkdir(parents=True, exist_ok=True)
    if not asked.report:
        who = {table.WHO: Asked(cases.answer)}
        try:
            with options.engine(asked) as pool, progress_bar("foreign records") as advance:
                collect.run(wanted, collect.Store(root), who, pool, asked.jobs, advance, note, cases.make)
        except KeyboardInterrupt:
            note(f"{root} keeps what is finished; the same command goes on from there")
            code = INTERRUPTED
        except collect.ClusterError as error:
            note(str(error))
            return 2
    try:
        print(table.write(root, wanted))
    except FileNotFoundError as error:
        note(str(error))
        return code or 1
    return code


if __name__ == "__main__":
    processes.end_on_sigterm()
    sys.exit(main())
