"""The answer of ``hapticd gap`` on one measured record, and how it is told."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.report import BenchmarkError, Figure, progress
from hapticd.config import Config, config_to_yaml, load_config
from hapticd.gap import find_gap
from hapticd.gap.recording import Recording

_FIRST_S = 4.0


class Answered(NamedTuple):
    """What was found in a record."""

    document: dict[str, Any]
    """As gap.json has it."""
    improved: Config
    """The model that was written."""
    seconds: float
    """Of the command, from its start to its end."""


def beginning(recording: Recording, seconds: float = _FIRST_S) -> Recording:
    """The first seconds of a record."""
    rows = int((recording.time_s <= seconds).sum())
    arrays = ("time_s", "position", "current", "current_measured")
    parts = {name: getattr(recording, name) for name in arrays}
    return replace(recording, **{name: part if part is None else part[:rows] for name, part in parts.items()})


def compile_on(recording: Recording, model: Config, *, refit_base: bool) -> None:
    """Compile what the workflow needs, so that the next answer is timed without that."""
    find_gap([beginning(recording)], model, refit_base=refit_base)


def answer(run: Path, model: Config, *, refit_base: bool) -> Answered:
    """Find what the model of a run lacks, as a user would; everything is written beside the run."""
    nominal, out = run.with_suffix(".yaml"), run.with_suffix("")
    nominal.write_text(config_to_yaml(model), encoding="utf-8")
    hapticd = str(Path(sys.executable).with_name("hapticd"))
    command = [hapticd, "gap", str(run), "--model", str(nominal), "--force", "-o", str(out)]
    begin = time.perf_counter()
    done = subprocess.run([*command, *(["--refit-base"] if refit_base else [])], check=False, stdout=subprocess.PIPE)
    seconds = time.perf_counter() - begin
    if done.returncode not in (0, 1):  # 1: nothing of the catalogue explains it
        raise BenchmarkError(f"{' '.join(command)} ended with {done.returncode}")
    document = json.loads((out / "gap.json").read_text(encoding="utf-8"))
    return Answered(document, load_config(out / "model.yaml"), seconds)


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
