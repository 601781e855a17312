"""Writes the result: gap.json, model.yaml, report.html and the figures, all of them or none."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import yaml
from pydantic_core import to_jsonable_python

from drivers import declared_latency
from hapticd.config.editing import text_of
from hapticd.effects.catalogue import CATALOGUE
from hapticd.figures.files import naming, refuse_existing
from hapticd.gap.consequences import consequences
from hapticd.gap.design import FILE as EXPERIMENT
from hapticd.gap.model_file import changed_lines, improved_model, model_yaml
from hapticd.gap.next_step import next_step
from hapticd.gap.report import page

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.gap.recording import Recording
    from hapticd.gap.result import GapResult

JSON: Final = "gap.json"
MODEL: Final = "model.yaml"
REPORT: Final = "report.html"
FILES: Final = (JSON, MODEL, REPORT, EXPERIMENT)


def document_of(result: GapResult, model: Config) -> dict[str, Any]:
    """The document of gap.json."""
    changes = consequences(model, improved_model(model, result), declared_latency(model)[0])
    found = result.to_json()
    return {**found, "consequences": changes, "next": next_step(found)}


def keep(folder: Path, read: Iterable[Path], *, force: bool) -> None:
    """Refuse a folder in which `write_outputs` would overwrite a file.

    Raises:
        FileExistsError: an output file exists and ``force`` is not given, or it is one of the input files ``read``.
    """
    sources = list(read)
    for path in (folder / name for name in FILES):
        for source in sources:
            refuse_existing(path, force=True, source=source)
        refuse_existing(path, force=force)


def write_outputs(
    document: Mapping[str, Any],
    result: GapResult,
    recordings: Sequence[Recording],
    model: Config,
    folder: Path,
    source: str | None = None,
) -> None:
    """Write all outputs into a folder, which is created if missing.

    Files appear when all are finished: an interruption does not change the folder.

    Args:
        document: of gap.json. result: of the workflow. recordings: that were fitted. model: the given model.
        folder: to write to. source: file or preset of the model; its comments and order are kept.
    """
    before = text_of(source, model)
    text = model_yaml(model, result, [recording.name for recording in recordings], before)
    plain = to_jsonable_python(document, inf_nan_mode="null", fallback=lambda value: value.tolist())
    files = {
        JSON: json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n",
        MODEL: text,
        REPORT: page(result, recordings, document["consequences"], CATALOGUE, changed_lines(before, text)),
    }
    if result.next_experiment and result.next_experiment["experiment"]:
        files[EXPERIMENT] = yaml.safe_dump(dict(result.next_experiment["experiment"]), sort_keys=False)
    folder.mkdir(parents=True, exist_ok=True)
    with naming(folder), tempfile.TemporaryDirectory(dir=folder, prefix=".") as scratch:
        for name, content in files.items():
            (Path(scratch) / name).write_text(content, encoding="utf-8")
        for name in files:
            (Path(scratch) / name).replace(folder / name)
    if EXPERIMENT not in files:
        (folder / EXPERIMENT).unlink(missing_ok=True)
