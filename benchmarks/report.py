"""What every benchmark reports: figures with their goal and peer, as one table and as JSON.

A missed goal is a result, not an error: the exit code says only whether the measurement itself could be made.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.table import Table

from hapticd.record import host_facts, versions

_NARROWEST = 132


class BenchmarkError(Exception):
    """A measurement cannot be made; the text says why."""


class NotHereError(BenchmarkError):
    """This machine lacks what the measurement needs; the text says what, and how to get it."""


@dataclass(frozen=True)
class Figure:
    """One measured number.

    Attributes:
        name: what was measured.
        value: the number, in ``unit`` (``×`` for a ratio).
        goal: the bound it is to keep, on the side that ``bound`` names; None for a figure without a goal.
        peer: what a ratio is against.
        details: the numbers behind it, for the JSON document.
    """

    name: str
    value: float
    unit: str
    goal: float | None = None
    bound: Literal["≤", "≥"] = "≤"
    peer: str = ""
    details: dict[str, Any] = field(default_factory=dict)

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None where there is none."""
        if self.goal is None:
            return None
        return self.value <= self.goal if self.bound == "≤" else self.value >= self.goal


Measurement = Callable[[bool], list[Figure]]
"""A benchmark: takes ``quick`` and returns its figures."""


def progress(text: str) -> None:
    """One line of progress, on stderr."""
    print(text, file=sys.stderr, flush=True)


def document(name: str, figures: Iterable[Figure], quick: bool) -> dict[str, Any]:
    """The JSON document of one benchmark."""
    return {
        "benchmark": name,
        "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "quick": quick,
        "host": host_facts(),
        "versions": versions(),
        "figures": [{**asdict(figure), "met": figure.met} for figure in figures],
    }


def print_table(documents: Iterable[dict[str, Any]]) -> None:
    """All figures in one table on stdout."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=max(console.width, _NARROWEST))
    table = Table("benchmark", "figure", "value", "goal", "against", "met")
    table.columns[2].justify = "right"
    for entry in documents:
        for index, figure in enumerate(entry["figures"]):
            goal = "" if figure["goal"] is None else f"{figure['bound']} {figure['goal']:g} {figure['unit']}"
            met = {None: "", True: "yes", False: "NO"}[figure["met"]]
            name = entry["benchmark"] if index == 0 else ""
            value = f"{figure['value']:.4g} {figure['unit']}"
            table.add_row(name, figure["name"], value, goal, figure["peer"], met)
        table.add_section()
    console.print(table)


def module_of(name: str) -> str:
    """Where the ``measure`` of a benchmark is."""
    place = f"benchmarks.{name}"
    found = find_spec(place)
    return f"{place}.__main__" if found is not None and found.submodule_search_locations else place


def run(name: str, quick: bool) -> dict[str, Any]:
    """Make one measurement; its JSON document, in which ``skipped`` says why this machine cannot.

    Raises:
        BenchmarkError: it could not be made.
    """
    measure: Measurement = import_module(module_of(name)).measure
    try:
        return document(name, measure(quick), quick)
    except NotHereError as error:
        return {**document(name, (), quick), "skipped": str(error)}


def run_to_file(argv: Sequence[str]) -> None:
    """``NAME FILE [quick]``: make one measurement and write its document; ends this process with 1 where that failed."""
    name, path, *quick = argv
    try:
        found = run(name, bool(quick))
    except BenchmarkError as error:
        sys.exit(f"{name}: {error}")
    Path(path).write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
