"""The workflow's answer on one measured record, through its public call, and how it is told."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, NamedTuple

from benchmarks.report import Figure, progress
from hapticd.config import Config
from hapticd.gap import GapResult, find_gap
from hapticd.gap.recording import Recording

_FIRST_S = 4.0


class Answered(NamedTuple):
    """What was found in a record."""

    result: GapResult
    document: dict[str, Any]
    """As gap.json has it."""
    seconds: float


def beginning(recording: Recording, seconds: float = _FIRST_S) -> Recording:
    """The first seconds of a record."""
    rows = int((recording.time_s <= seconds).sum())
    arrays = ("time_s", "position", "current", "current_measured")
    parts = {name: getattr(recording, name) for name in arrays}
    return replace(recording, **{name: part if part is None else part[:rows] for name, part in parts.items()})


def compile_on(recording: Recording, model: Config, *, refit_base: bool) -> None:
    """Compile what the workflow needs, so that the next answer is timed without that."""
    find_gap([beginning(recording)], model, refit_base=refit_base)


def answer(recording: Recording, model: Config, *, refit_base: bool) -> Answered:
    """Find what the model of this record lacks."""
    begin = time.perf_counter()
    result = find_gap([recording], model, refit_base=refit_base)
    return Answered(result, result.to_json(), time.perf_counter() - begin)


def tell(name: str, found: Answered) -> None:
    """Verdict, names with their parameters, warnings, and what is left, on stderr."""
    document = found.document
    progress(f"{name}: {document['verdict']} in {found.seconds:.1f} s")
    for step in document["steps"]:
        values = ", ".join(
            f"{key} {estimate['value']:.4g} ({' to '.join(map(_number, estimate['ci95']))}) {estimate['unit']}".rstrip()
            for key, estimate in step["parameters"].items()
        )
        ties = step["indistinguishable_from"]
        progress(f"  {step['effect']}: {values}{' or ' + ', '.join(ties) if ties else ''}")
    for warning in document["warnings"]:
        progress(f"  {warning}")
    if words := document.get("remainder", {}).get("words"):
        progress(f"  left: {words}")


def _number(value: float | None) -> str:
    return "?" if value is None else f"{value:.4g}"


def figures(name: str, found: Answered) -> list[Figure]:
    """Seconds, and the missing force before and after."""
    gap, unit = found.document["gap"], found.document["gap"].get("unit", "")
    details = {"verdict": found.document["verdict"], "steps": found.document["steps"]}
    return [
        Figure(f"{name}, seconds", found.seconds, "s", details=details),
        *(
            Figure(f"{name}, missing force {when}, {part.replace('_', ' ')}", gap[part][when], unit)
            for part in ("train", "held_out")
            for when in ("before", "after")
        ),
    ]
