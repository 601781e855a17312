"""Export a run to CSV, Parquet, MATLAB or MCAP, metadata included.

Each format keeps the run in one file that describes itself: CSV has the metadata in the first row of its last column (a CSV
has no comments: whoever reads one without being told so takes them for rows), Parquet in its schema, MAT in a struct
``hapticd``, MCAP in a Metadata record (`hapticd.record.mcap`). The file appears whole under its name or not at all.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from hapticd.figures.files import refuse_existing
from hapticd.record._reader import CSV_METADATA_COLUMN
from hapticd.record.errors import RunFileError
from hapticd.record.files import written
from hapticd.record.mcap import distinct, write_mcap
from hapticd.record.metadata import encode_metadata, to_plain
from hapticd.record.run import Run

_MATLAB_NAME_LENGTH = 63
CSV_FILLER = "."
"""In the rows below the metadata."""


def export(run: Run, to: str, out: str | Path | None = None, *, force: bool = False) -> Path:
    """Write the run in another format, through a temporary file beside ``out`` that is renamed when whole.

    Args:
        run: what `reader.read_run` gave.
        to: ``csv``, ``parquet``, ``mat`` or ``mcap``.
        out: the file; None: the run's own name with the format's suffix.
        force: replace a file that exists.

    Returns:
        The file written.

    Raises:
        FileExistsError: ``out`` exists, or is the run file.
        RunFileError: unknown format; it cannot be written (nothing is left behind).
    """
    if to not in _WRITERS:
        raise RunFileError(f"cannot export to {to!r}: the formats are {', '.join(_WRITERS)}")
    target = Path(out) if out is not None else run.path.with_suffix(f".{to}")
    if target.is_dir():
        raise RunFileError(f"{target} is a folder; give a file name")
    refuse_existing(target, force=force, source=run.path)
    with written(target) as part, part.open("wb") as file:
        _WRITERS[to](run, file)
        file.flush()
        os.fsync(file.fileno())
    return target


def _metadata(run: Run) -> dict[str, Any]:
    lost = [{"event": "damaged", "first_row": part.first_row, "end_row": part.end_row} for part in run.damage]
    return {**run.metadata, "units": run.units, "events": run.events + lost, "truncated": run.truncated}


def _table(run: Run) -> Any:
    import pyarrow as pa

    fields, arrays = [], []
    for name, values in run.columns.items():
        array = pa.array(values)
        arrays.append(array)
        unit = {"unit": run.units[name]} if name in run.units else None
        fields.append(pa.field(name, array.type, metadata=unit))
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=encode_metadata(_metadata(run))))


def _write_csv(run: Run, file: BinaryIO) -> None:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    table = _table(run)
    text = json.dumps(to_plain(_metadata(run)), ensure_ascii=False, allow_nan=False)
    # All rows hold a text: a column whose later parts are empty has two types to pandas, which warns.
    column = [text, *[CSV_FILLER] * (run.rows - 1)] if run.rows else []
    table = table.append_column(CSV_METADATA_COLUMN, pa.array(column, pa.string()))
    pacsv.write_csv(table, file, pacsv.WriteOptions(quoting_style="needed"))


def _write_parquet(run: Run, file: BinaryIO) -> None:
    import pyarrow.parquet as pq

    pq.write_table(_table(run), file)


def _write_mat(run: Run, file: BinaryIO) -> None:
    from scipy.io import savemat

    stream: Any = file
    metadata = _metadata(run)
    names = _legal_names([*run.columns, "hapticd"])
    contents: dict[str, Any] = {names[name]: values for name, values in run.columns.items()}
    contents["hapticd"] = {**_matlab(metadata), "json": json.dumps(metadata, ensure_ascii=True)}
    savemat(stream, contents, long_field_names=True, oned_as="column", do_compression=True)


def _write_mcap(run: Run, file: BinaryIO) -> None:
    write_mcap(run.columns, run.units, _metadata(run), file)


def _legal_names(names: list[str]) -> dict[str, str]:
    """MATLAB names (a letter, then letters, digits, ``_``; at most 63) for the given ones, all different."""

    def spelled(name: str) -> str:
        base = re.sub(r"\W", "_", name, flags=re.ASCII)
        return base if re.match(r"[A-Za-z]", base) else f"x{base}"

    return distinct(sorted(names, key=lambda name: name != "hapticd"), spelled, _MATLAB_NAME_LENGTH)


def _matlab(value: Any) -> Any:
    """A JSON value as MATLAB has it: struct, cell, text, number; an absent value is an empty array."""
    if isinstance(value, Mapping):
        names = _legal_names([str(key) for key in value])
        return {names[str(key)]: _matlab(item) for key, item in value.items()}
    if isinstance(value, list):
        cell = np.empty((1, len(value)), dtype=object)
        for index, item in enumerate(value):
            cell[0, index] = _matlab(item)
        return cell
    return np.empty((0, 0)) if value is None else value


_WRITERS: dict[str, Callable[[Run, BinaryIO], None]] = {
    "csv": _write_csv,
    "parquet": _write_parquet,
    "mat": _write_mat,
    "mcap": _write_mcap,
}
