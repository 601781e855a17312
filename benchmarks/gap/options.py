"""What the benchmark's commands have in common: where to, which seeds, on how many cores or which cluster."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from pathlib import Path

from benchmarks.gap import collect, plan, processes


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


def add_common(parser: argparse.ArgumentParser, output: Path) -> None:
    """Options of every command that runs cases."""
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", default=output)
    add_engine(parser)


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
