"""Writes what the workflow found: gap.json, model.yaml, report.html and the figures, all of them or none."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import yaml
from pydantic_core import to_jsonable_python

from drivers import declared_latency
from hapticd.effects.catalogue import CATALOGUE
from hapticd.figures.files import naming
from hapticd.gap.consequences import consequences
from hapticd.gap.design import FILE as EXPERIMENT
from hapticd.gap.model_file import improved_model, model_yaml
from hapticd.gap.report import page

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.gap.recording import Recording
    from hapticd.gap.result import GapResult

JSON: Final = "gap.json"
MODEL: Final = "model.yaml"
REPORT: Final = "report.html"


def write_outputs(result: GapResult, recordings: Sequence[Recording], model: Config, folder: Path) -> dict[str, Any]:
    """Write everything into a folder, which is made if missing, and return the document of gap.json.

    Files appear when all are finished: an interruption leaves the folder as it was.
    """
    improved = improved_model(model, result)
    changes = consequences(model, improved, declared_latency(model)[0])
    text = model_yaml(model, result, [recording.name for recording in recordings])
    document = {**result.to_json(), "consequences": changes}
    plain = to_jsonable_python(document, inf_nan_mode="null", fallback=lambda value: value.tolist())
    files = {
        JSON: json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n",
        MODEL: text,
        REPORT: page(result, recordings, changes, {slug: spec.summary for slug, spec in CATALOGUE.items()}, text),
    }
    if result.next_experiment and result.next_experiment["experiment"]:
        files[EXPERIMENT] = yaml.safe_dump(dict(result.next_experiment["experiment"]), sort_keys=False)
    folder.mkdir(parents=True, exist_ok=True)
    with naming(folder), tempfile.TemporaryDirectory(dir=folder, prefix=".") as scratch:
        for name, content in files.items():
            (Path(scratch) / name).write_text(content, encoding="utf-8")
        for name in files:
            shutil.move(Path(scratch) / name, folder / name)
    if EXPERIMENT not in files:
        (folder / EXPERIMENT).unlink(missing_ok=True)
    return document
