"""What one worker does with one case: make it, run the workflow on it, run the peer on it.

The workflow and the peer get the bytes of the case's files and nothing else; the truth stays with the process that
collects. Each function is one task for a process pool or a Dask worker.
"""

from __future__ import annotations

import importlib
import resource
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap import recipes
from benchmarks.gap.cases import Files, case_files, write_files
from benchmarks.gap.generate import UnstableError, generate, visibility
from benchmarks.gap.hidden import Effect
from benchmarks.gap.plan import Case

_MOST_DRAWS = 8

Made = tuple[Files, dict[str, Any]]
"""A case's files, and its truth."""


def make(case: Case) -> Made:
    """Draw the effects of a case at the strength asked for, and record them.

    Raises:
        UnstableError: no draw leaves the session possible.
    """
    for attempt in range(_MOST_DRAWS):
        rng = np.random.default_rng([case.seed, attempt])
        try:
            effects = [_sized(case, slug, rng) for slug in case.slugs]
            recording = generate(effects, case.seed, case.duration_s, case.device)
        except UnstableError:
            continue
        alone = [visibility(recording, [other for other in effects if other is not effect]) for effect in effects]
        truth = {
            "kind": case.kind,
            "slugs": list(case.slugs),
            "strength": case.strength,
            "seed": case.seed,
            "device": case.device,
            "form": case.form,
            "effects": effects,
            "visibility": visibility(recording),
            "visibility_beside_the_others": alone,
            "stiffness": recording.stiffness,
            "coulomb": recording.nominal["plant"]["coulomb"],
        }
        return case_files(recording, case.form), truth
    raise UnstableError(f"{' and '.join(case.slugs)} on {case.device}, seed {case.seed}: no draw of {_MOST_DRAWS}")


def _sized(case: Case, slug: str, rng: np.random.Generator) -> Effect:
    recipe = recipes.draw(slug, case.device, rng, case.duration_s)
    return recipes.sized(recipe, recipes.VISIBILITY[case.strength], case.seed, case.duration_s, case.device)[0]


def timed(answer: Callable[[Path], dict[str, Any]], files: Files) -> dict[str, Any]:
    """Give the files of a case to something that answers, in a folder of their own; an exception is an answer too."""
    with tempfile.TemporaryDirectory(prefix="gap-") as folder:
        write_files(Path(folder), files)
        begin = time.perf_counter()
        try:
            found = answer(Path(folder))
        except Exception:
            found = {"error": traceback.format_exc(limit=-6)}
        spent = time.perf_counter() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return {**found, "wall_s": spent, "peak_memory_MB": memory}


def run_file(folder: Path) -> Path:
    """The recording in a case's folder."""
    return next(folder.glob("run.*"))


def workflow(files: Files, excluded: Sequence[str] = ()) -> dict[str, Any]:
    """What hapticd's gap workflow answers, as gap.json has it, and the time it took."""

    def answer(folder: Path) -> dict[str, Any]:
        from hapticd.config import EFFECT_SLUGS, load_config

        gap = importlib.import_module("hapticd.gap")
        data = importlib.import_module("hapticd.gap.data")
        model = load_config(folder / "model.yaml")
        candidates = [slug for slug in EFFECT_SLUGS if slug not in excluded] if excluded else None
        recordings = [data.load_recording(run_file(folder), model)]
        found: dict[str, Any] = gap.find_gap(recordings, model, candidates=candidates, design=False).to_json()
        return found

    return timed(answer, files)


def peer(files: Files, excluded: Sequence[str] = ()) -> dict[str, Any]:
    """What sparse regression with PySINDy answers, and the time it took; it has no use for excluded names."""
    from benchmarks.gap.peer import identify

    return timed(identify, files)
