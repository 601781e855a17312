"""What the benchmark's commands have in common: where to, which seeds, on how many cores or which cluster."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from benchmarks.gap import collect, plan, processes, tasks
from benchmarks.report import progress as note
from hapticd.cli.output import progress_bar

INTERRUPTED = 130


def seeds(text: str) -> range:
    """``A:B`` for seeds A to B − 1, or one seed.

    Raises:
        ArgumentTypeError: no seeds, or some of either purpose.
    """
    first, _, last = text.partition(":")
    try:
        found = range(int(first), int(last) if last else int(first) + 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a seed nor a range A:B") from None
    if not found or found[0] < 0:
        raise argparse.ArgumentTypeError(f"{text!r} has no seed")
    if plan.is_for_development(found[0]) and not plan.is_for_development(found[-1]):
        raise argparse.ArgumentTypeError(
            f"{text!r}: seeds below {plan.FIRST_REPORTED_SEED} are to develop on, the others for the report; not both"
        )
    return found


def parser_of(module: str, doc: str | None, output: Path, epilog: str | None = None) -> argparse.ArgumentParser:
    """With the options of every command that runs cases and keeps what is answered."""
    shown = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=doc, formatter_class=shown, epilog=epilog)
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", default=output)
    parser.add_argument("--report", action="store_true", help="score what is there and run nothing")
    add_engine(parser)
    return parser


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Options of where cases run."""
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N", help="processes")
    parser.add_argument("--dask", metavar="ADDRESS", help="run on this Dask cluster instead, e.g. tcp://host:8786")


def cases(module: str, doc: str, default: range) -> tuple[argparse.Namespace, list[plan.Case]]:
    """Options of a command that prints a table of some cases, and all cases of the seeds that were asked for.

    Args:
        module: its name. doc: its docstring; the second paragraph says what it does. default: seeds.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=doc.split("\n\n")[1])
    parser.add_argument("--seed", type=seeds, default=default, metavar="A:B", help="seeds of the cases, as 0:20")
    add_engine(parser)
    chosen = parser.parse_args()
    check(parser, chosen)
    return chosen, plan.draw(plan.FULL, chosen.seed)


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *lines))


def check(parser: argparse.ArgumentParser, chosen: argparse.Namespace) -> None:
    """End with a message where the options make no sense."""
    if chosen.jobs < 1:
        parser.error("--jobs: at least 1")


def engine(chosen: argparse.Namespace) -> AbstractContextManager[Executor]:
    """Where the cases run."""
    return collect.dask(chosen.dask) if chosen.dask else processes.pool(chosen.jobs)


def answer_and_report(
    chosen: argparse.Namespace,
    cases: Sequence[Any],
    answerers: Callable[[], Mapping[str, collect.Asked]],
    write: Callable[[Path, Sequence[Any]], str],
    title: str,
    make: Callable[[Any], tasks.Made] = tasks.make,
) -> int:
    """Run, or go on; then report. 1 when there is nothing to report, 2 when what was asked for cannot be used.

    Args:
        chosen: the command line, of `parser_of`. cases: of the plan. answerers: who is asked; an ImportError says what is
            missing. write: writes the report and returns it. title: of the progress bar. make: as `collect.run`.
    """
    root, code = chosen.output, 0
    root.mkdir(parents=True, exist_ok=True)
    if not chosen.report:
        try:
            who = answerers()
            with engine(chosen) as pool, progress_bar(title) as advance:
                collect.run(cases, collect.Store(root), who, pool, chosen.jobs, advance, note, make)
        except KeyboardInterrupt:
            note(f"{root} keeps what is finished; the same command goes on from there")
            code = INTERRUPTED
        except (collect.ClusterError, ImportError) as error:
            note(str(error))
            return 2
    try:
        print(write(root, cases))
    except FileNotFoundError as error:
        note(str(error))
        return code or 1
    return code
