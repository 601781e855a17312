"""A case on disk: what the workflow is given in one folder, and the truth in another.

<root>/cases/<case>/run.csv | run.parquet | run.arrow, model.yaml
<root>/truth/<case>.json
"""

from __future__ import annotations

import io
import json
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.gap import devices
from benchmarks.gap.generate import Recording

Files = dict[str, bytes]
"""File name to content: all that the workflow gets."""

FORMS = ("csv", "parquet", "arrow")


def case_files(recording: Recording, form: str) -> Files:
    """The files that the workflow gets.

    In .csv and .parquet the time stamps are those of the samples; the native form has the grid's instants and lateness.

    Args:
        recording: one recording.
        form: one of `FORMS`.
    """
    content = {"csv": _csv, "parquet": _parquet, "arrow": _native}[form](recording)
    return {f"run.{form}": content, "model.yaml": yaml.safe_dump(recording.nominal, sort_keys=False).encode()}


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files of a case; each is whole or absent."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_atomically(folder / name, content)


def run_file(folder: Path) -> Path:
    """The recording in a case's folder."""
    return next(folder.glob("run.*"))


def write_atomically(path: Path, content: bytes) -> None:
    """Through a temporary file beside the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as part:
        part.write(content)
    Path(part.name).replace(path)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """A JSON document, whole or absent."""
    write_atomically(path, (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode())


def _columns(recording: Recording) -> dict[str, np.ndarray]:
    return {
        "time_s": recording.time_s,
        "encoder_counts": recording.counts,
        "current_command_A": recording.current_command,
    }


def _csv(recording: Recording) -> bytes:
    text = io.StringIO()
    columns = _columns(recording)
    np.savetxt(
        text,
        np.column_stack(list(columns.values())),
        fmt=["%.7f", "%d", "%.9g"],
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    return text.getvalue().encode()


def _parquet(recording: Recording) -> bytes:
    return parquet_of(_columns(recording))


def parquet_of(columns: Mapping[str, np.ndarray]) -> bytes:
    """Bare columns as a .parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = io.BytesIO()
    pq.write_table(pa.table(dict(columns)), sink)
    return sink.getvalue()


def _native(recording: Recording) -> bytes:
    from hapticd.config import parse_config
    from hapticd.record import RunWriter, run_metadata
    from hapticd.record.schema import FLAG_EXCITATION, FLAG_RUNNING, empty_rows

    played = {**recording.nominal, "spring": {"stiffness": recording.stiffness}}
    config = parse_config(played, "benchmark").model_dump(mode="json")
    rows = empty_rows(recording.counts.size)
    rows["tick"] = np.arange(rows.size)
    rows["time_s"] = recording.time_s - recording.lateness_s
    rows["encoder_counts"] = recording.counts
    rows["ticks"] = recording.counts - recording.origin_counts.astype(np.int64)
    rows["current_command_A"] = recording.current_command
    rows["current_measured_A"] = math.nan
    rows["force_command"] = -recording.stiffness * devices.resolution(recording.nominal) * (rows["ticks"] + 0.5)
    rows["wake_late_ns"] = np.rint(recording.lateness_s * 1e9)
    rows["exec_ns"] = 12_000
    rows["flags"] = FLAG_RUNNING | FLAG_EXCITATION
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.arrow"
        with RunWriter(path, run_metadata(config)) as writer:
            writer.write(rows)
        return path.read_bytes()
