"""``python -m benchmarks.gap.constants``: how much the answers depend on each constant of the verdict.

Every number that `hapticd.gap.constants` names in capitals is taken times 0.7 and times 1.4, one at a time, and the workflow
answers the same small plan again. Where a rate hardly moves, the constant was not tuned to these cases; where no answer is
another one, nothing in them needed it.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from benchmarks.gap import collect, options, plan, processes, score, summary, tasks
from benchmarks.gap.cases import write_atomically, write_json
from benchmarks.gap.collect import Asked
from benchmarks.gap.rate import Rate
from benchmarks.gap.summary import Scored
from benchmarks.report import progress as note
from hapticd.cli.output import progress_bar

MODULE = "hapticd.gap.constants"
FACTORS = (0.7, 1.4)
SMALL = plan.Size(single=3, none=2, pair=0, wrong_base=0, left_out=1)
SEEDS = range(2000, 2008)
"""Of the small plan: every effect once, 16 with nothing hidden, 8 left out; developed on by nobody."""
_AS_IT_IS = "as it is"
_INTERRUPTED = 130


class Variant(NamedTuple):
    """One constant with another value; none for the workflow as it is."""

    label: str
    values: Mapping[str, float]

    @property
    def folder(self) -> str:
        """Where its answers are kept; another value is another folder."""
        changes = [f"{name}={value:g}" for name, value in self.values.items()]
        return "/".join(["constants", *(changes or ["as-it-is"])])


def numbers(module: ModuleType) -> dict[str, float]:
    """The numbers that a module names in capitals."""
    return {
        name: value
        for name, value in vars(module).items()
        if name.isupper()
        and not name.startswith("_")
        and isinstance(value, int | float)
        and not isinstance(value, bool)
    }


def changed(value: float, factor: float) -> float:
    """A constant times a factor; a whole number stays whole, moves by one at least, and stays positive."""
    if not isinstance(value, int):
        return value * factor
    moved = math.floor(value * factor) if factor < 1.0 else math.ceil(value * factor)
    return max(1, moved) if value > 0 else moved


def variants(constants: Mapping[str, float]) -> list[Variant]:
    """The workflow as it is, then every constant with each factor, where that is another value."""
    return [Variant(_AS_IT_IS, {})] + [
        Variant(f"{name} = {value:g} × {factor:g}", {name: changed(value, factor)})
        for name, value in constants.items()
        for factor in FACTORS
        if changed(value, factor) != value
    ]


def rates(scored: Sequence[Scored]) -> dict[str, Rate]:
    """What the table shows."""
    single = summary.of_kind(scored, "single")
    strong = [one for one in single if summary.is_strong(one)]
    return {
        "first name": summary.rate(strong, summary.is_named),
        "wrong further": summary.rate(single, summary.has_wrong_further),
        "false alarms": summary.rate(summary.of_kind(scored, "none"), lambda one: score.is_alarm(one.answer)),
        "left-out wrong": summary.rate(summary.of_kind(scored, "left_out"), summary.is_wrong),
        "errors": summary.rate(scored, lambda one: "error" in one.answer),
    }


def _answer(one: Scored) -> tuple[str, frozenset[str]]:
    return score.verdict_of(one.answer), frozenset(one.answer.get("effects", ()))


def other_answers(scored: Sequence[Scored], as_it_is: Sequence[Scored]) -> Rate:
    """The cases, answered both times, in which the verdict or the names differ."""
    before = {one.truth["name"]: _answer(one) for one in as_it_is}
    return summary.rate(
        [one for one in scored if one.truth["name"] in before], lambda one: _answer(one) != before[one.truth["name"]]
    )


def table(rows: Mapping[str, Mapping[str, Rate]]) -> str:
    """One line a variant, with Wilson intervals of 95 %."""
    heads = next(iter(rows.values()))
    width = max(map(len, rows))
    lines = [f"{'':{width}}  " + "  ".join(f"{head:26}" for head in heads)]
    lines += [f"{label:{width}}  " + "  ".join(f"{rate!s:26}" for rate in row.values()) for label, row in rows.items()]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def write(root: Path, tried: Sequence[Variant], cases: Sequence[plan.Case]) -> str:
    """Score, write constants.txt and constants.json, and return the text."""
    answered = {one.label: summary.load(root, one.folder, cases) for one in tried}
    rows = {
        label: {**rates(scored), "another answer": other_answers(scored, answered[_AS_IT_IS])}
        for label, scored in answered.items()
    }
    text = table(rows)
    write_atomically(root / "constants.txt", text.encode())
    document = {
        label: {name: {"hits": rate.hits, "of": rate.of, "wilson": list(rate.interval)} for name, rate in row.items()}
        for label, row in rows.items()
    }
    write_json(root / "constants.json", document)
    return text


def parse(argv: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap.constants", description=__doc__.splitlines()[0])
    options.add_common(parser, Path(__file__).parent.parent / "results/gap_constants")
    parser.add_argument(
        "--seed",
        type=options.seeds,
        default=SEEDS,
        metavar="A:B",
        help=f"seeds A to B − 1 (default {SEEDS.start}:{SEEDS.stop})",
    )
    parser.add_argument("--only", action="append", metavar="NAME", help="this constant alone; repeatable")
    parser.add_argument("--most", type=int, metavar="N", help="at most so many cases")
    chosen = parser.parse_args(argv)
    options.check(parser, chosen)
    return chosen


def main(argv: list[str] | None = None) -> int:
    """Run, or go on; then print the table. 2 when there are no constants to change."""
    asked = parse(argv)
    try:
        constants = numbers(importlib.import_module(MODULE))
    except ModuleNotFoundError:
        note(f"there is no module {MODULE}: this workflow's constants cannot be changed from outside")
        return 2
    if unknown := [name for name in asked.only or () if name not in constants]:
        note(f"{MODULE} has no number {', '.join(unknown)}; there are {', '.join(constants)}")
        return 2
    tried = variants({name: value for name, value in constants.items() if not asked.only or name in asked.only})
    cases = plan.draw(SMALL, asked.seed)[: asked.most]
    who = {one.folder: Asked(partial(tasks.workflow, constants=dict(one.values))) for one in tried}
    asked.output.mkdir(parents=True, exist_ok=True)
    code = 0
    try:
        with options.engine(asked) as pool, progress_bar("gap constants") as advance:
            collect.run(cases, collect.Store(asked.output), who, pool, asked.jobs, advance, note)
    except KeyboardInterrupt:
        note(f"{asked.output} keeps what is finished; the same command goes on from there")
        code = _INTERRUPTED
    except collect.ClusterError as error:
        note(str(error))
        return 2
    print(write(asked.output, tried, cases), end="")
    return code


if __name__ == "__main__":
    processes.end_on_sigterm()
    sys.exit(main())
