"""What one worker does with one case: make it, run the workflow on it, run a peer on it.

The workflow and the peers get the bytes of the case's files and nothing else; the truth stays with the process that
collects. Each function is one task for a process pool or a Dask worker.
"""

from __future__ import annotations

import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.gap import processes, recipes
from benchmarks.gap.cases import Files, case_files, run_file, write_files
from benchmarks.gap.generate import STEP_S, Lab, UnstableError, generate, visibility
from benchmarks.gap.hidden import Effect
from benchmarks.gap.plan import Case

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.gap.recording import Recording

_MOST_DRAWS = 8
_OBSERVER_STEP_S = 4.0 * STEP_S

Answer = dict[str, Any]
Made = tuple[Files, dict[str, Any]]
"""A case's files, and its truth."""


def make(case: Case, lab: Lab | None = None) -> Made:
    """Draw the effects of a case at the strengths asked for, and a session, and record them.

    Args:
        case: what is to be hidden.
        lab: another device than the case's, and another excitation.

    Raises:
        UnstableError: no draw leaves the session possible.
    """
    for attempt in range(_MOST_DRAWS):
        session = int(np.random.SeedSequence([case.seed, case.number, attempt]).generate_state(1)[0])
        rng = np.random.default_rng([case.seed, case.number, attempt])
        try:
            effects = _effects(case, lab or case.device, session, rng)
            recording = generate(effects, session, case.duration_s, lab or case.device, coloured=case.coloured)
        except UnstableError:
            continue
        others = [[other for other in effects if other is not effect] for effect in effects]
        truth = {
            "kind": case.kind,
            "slugs": list(case.slugs),
            "strengths": list(case.strengths),
            "seed": case.seed,
            "number": case.number,
            "draws": attempt + 1,
            "device": case.device,
            "form": case.form,
            "coloured": case.coloured._asdict() if case.coloured else None,
            "effects": effects,
            "visibility": [visibility(recording, known, _OBSERVER_STEP_S) for known in others],
            "visibility_of_coloured": visibility(recording, effects, _OBSERVER_STEP_S, knows_coloured=False)
            if case.coloured
            else 0.0,
            "stiffness": recording.stiffness,
            "coulomb": recording.device.coulomb,
        }
        return case_files(recording, case.form), truth
    raise UnstableError(f"{' and '.join(case.slugs)} on {case.device}, seed {case.seed}: no draw of {_MOST_DRAWS}")


def _effects(case: Case, device: str | Lab, session: int, rng: np.random.Generator) -> list[Effect]:
    """Raises UnstableError where the session is too much for the device as it is."""
    if not case.slugs:
        return []
    scale = recipes.scale_of(device, session, case.duration_s)
    by_strength = case.slugs[:1] if case.kind == "wrong_base" else case.slugs
    found = [
        recipes.draw(slug, scale, rng)(strength) for slug, strength in zip(by_strength, case.strengths, strict=True)
    ]
    return [*found, recipes.wrong_base(case.slugs[1], rng)] if case.kind == "wrong_base" else found


def timed(answer: Callable[[Path], Answer], files: Files) -> Answer:
    """Give the files of a case to something that answers, in a folder of their own; an exception is an answer too."""
    processes.forget_peak_memory()
    with tempfile.TemporaryDirectory(prefix="gap-") as folder:
        write_files(Path(folder), files)
        begin, processor_begin = time.perf_counter(), time.process_time()
        try:
            found = answer(Path(folder))
        except Exception:
            found = {"error": traceback.format_exc(limit=-6)}
        spent = {"wall_s": time.perf_counter() - begin, "processor_s": time.process_time() - processor_begin}
    return {**spent, "peak_memory_MB": processes.peak_memory_mb(), **found}


def loaded(folder: Path) -> tuple[Recording, Config]:
    """The recording in a case's folder, and the nominal model beside it."""
    from hapticd.config import load_config
    from hapticd.gap.data import load_recording

    model = load_config(folder / "model.yaml")
    return load_recording(run_file(folder), model), model


def workflow(files: Files, excluded: Sequence[str] = ()) -> Answer:
    """What hapticd's gap workflow answers, as gap.json has it, and the time it took; it may not name what is excluded."""
    return timed(lambda folder: find(folder, excluded), files)


def find(folder: Path, excluded: Sequence[str] = ()) -> Answer:
    """The workflow's answer on a case's folder, through its public call."""
    from hapticd.config import EFFECT_SLUGS
    from hapticd.gap import find_gap

    recording, model = loaded(folder)
    candidates = [slug for slug in EFFECT_SLUGS if slug not in excluded] if excluded else None
    return find_gap([recording], model, candidates=candidates, refit_base=False).to_json()


def sindy(files: Files, excluded: Sequence[str] = ()) -> Answer:
    """What sparse regression with PySINDy answers, and the time it took; it has no use for excluded names."""
    from benchmarks.gap.sindy import identify

    return timed(identify, files)
