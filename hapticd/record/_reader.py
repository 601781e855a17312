"""Read a run: Arrow streams whose tail may be cut, and CSV and Parquet from hapticd or from elsewhere.

The least a run needs is time, a position and a command: `time_s`; `encoder_counts` or `position`;
`current_command_A` or `force`. Known columns come back in the types of `schema.ROW`, others as they are.
"""

from __future__ import annotations

import codecs
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.config.opening import open_regular
from hapticd.record._csv_layout import look
from hapticd.record.errors import RunFileError
from hapticd.record.mcap import read_mcap
from hapticd.record.metadata import decode_metadata
from hapticd.record.run import Run, time_warnings
from hapticd.record.schema import COLUMNS, ROW
from hapticd.record.sizes import check_unpacked, unpack_limit
from hapticd.record.stream import Damage, Stream, brief, from_json, mappings, read_stream

CSV_METADATA_COLUMN = "hapticd"
"""Of an exported CSV: its first row holds the metadata as JSON."""
_CSV_METADATA_LINE = "# hapticd "
"""Above the header of a CSV that hapticd exported before."""
_CSV_BLOCK_BYTES = 1 << 24
"""No row may be longer; the first one holds the metadata."""
_NEEDED = (("time_s",), ("encoder_counts", "position"), ("current_command_A", "force"))
_ELSEWHERE = (".mat", ".npy", ".npz", ".xlsx", ".xls", ".txt", ".tsv", ".h5", ".hdf5")
_IMPORT = "'hapticd import' brings in files with other names, units and formats"
_LARGEST = 2.0**63
_PARQUET_ROWS = 1 << 16
_DELIMITERS = ((";", ";"), ("\t", "\\t"), ("|", "|"), (" ", " "))
_FLOATS = [name for name in ROW.names or () if ROW[name].kind == "f"] + ["position", "force"]


def read_run(path: str | Path, *, salvage: bool = False) -> Run:
    """Read a run file: ``.csv``, ``.parquet``, ``.mcap``, anything else as a native Arrow stream.

    Args:
        path: the file.
        salvage: read what is left of a native file that is damaged, with the damage in `Run.damage` and in words.

    Raises:
        RunFileError: the file is missing, empty, damaged or no run file, lacks a column, or a known column holds something
            else.
    """
    path = Path(path)
    if not _regular_size(path):
        raise RunFileError(f"{path} is empty: its recording ended before anything was written")
    if path.suffix.lower() in _ELSEWHERE:
        raise RunFileError(f"{path} is not a run file; {_IMPORT}")
    damaged: list[str] = []
    damage: tuple[Damage, ...] = ()
    if path.suffix.lower() in _TABLES:
        table, events, whole = _TABLES[path.suffix.lower()](path), [], True
    else:
        stream = verify(path)
        table, events, whole, damage = _table(path, stream), stream.events, stream.whole, tuple(stream.damage)
        damaged = stream.damage_text
    if damaged and not salvage:
        raise RunFileError(
            f"{path} is damaged: {'; '.join(damaged)}; 'hapticd export {path} --to parquet --salvage' keeps the rest"
        )

    names = column_names(path, table)
    _check_names(path, names)
    columns = {name: _column(path, name, table.column(name)) for name in names}
    metadata = decode_metadata(table.schema.metadata)
    # An exported run keeps these in its metadata; a native one in its fields and batches.
    exported_units = _texts(metadata.pop("units", None)) or _standard_units(names, metadata)
    units = {
        f.name: f.metadata[b"unit"].decode(errors="replace")
        for f in table.schema
        if f.metadata and b"unit" in f.metadata
    }
    events = mappings(metadata.pop("events", [])) or events
    truncated = bool(metadata.pop("truncated", False)) or not whole
    warnings = [f"{path.name} was not ended properly; its rows end with the last whole batch"] if truncated else []
    warnings += [f"{path.name} is damaged: {text}" for text in damaged]
    warnings += time_warnings(columns["time_s"], columns.get("encoder_counts"))
    return Run(path, columns, metadata, units or exported_units, events, truncated, tuple(warnings), damage)


def verify(path: str | Path) -> Stream:
    """The batches of a native run file, every checksum compared.

    Raises:
        RunFileError: it cannot be read, or is no native run file.
    """
    path = Path(path)
    if path.suffix.lower() in _TABLES:
        raise RunFileError(f"{path} has no checksums; only native run files (.arrow) have")
    try:
        return read_stream(path, path.read_bytes())
    except OSError as error:
        raise RunFileError(f"cannot read {path}: {error.strerror}") from error


def column_names(path: Path, table: Any) -> list[str]:
    """Names of the columns of a ``pyarrow.Table``.

    Raises:
        RunFileError: they are no text.
    """
    try:
        return [str(name) for name in table.column_names]
    except UnicodeDecodeError:
        if path.suffix.lower() == ".csv":
            raise RunFileError(not_utf8(path)) from None
        raise RunFileError(f"{path} is damaged: its columns have no legible names") from None


def refuse_utf16(path: Path) -> None:
    """Refuse a text that begins as UTF-16 does: with its mark, or with half a sign that is zero.

    Raises:
        RunFileError: it does.
    """
    with path.open("rb") as file:
        begins = file.read(2)
    if b"\0" in begins or begins in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        raise RunFileError(not_utf8(path, "UTF-16", "utf-16"))


def not_utf8(path: Path, likely: str = "Latin-1", code: str = "latin1") -> str:
    """What to do about a text in another encoding."""
    return f"{path} is not UTF-8 ({likely}?); 'iconv -f {code} -t utf-8 {path.name} > utf8.csv' converts it"


def _table(path: Path, stream: Stream) -> Any:
    import pyarrow as pa

    try:
        return pa.Table.from_batches(stream.batches, stream.schema)
    except (pa.ArrowException, ValueError) as error:
        raise RunFileError(f"{path} is damaged: {brief(error)}") from None


def _regular_size(path: Path) -> int:
    """Size of a regular file, in bytes.

    Raises:
        RunFileError: it is none, or cannot be read.
    """
    try:
        with open_regular(path) as file:
            return os.fstat(file.fileno()).st_size
    except OSError as error:
        raise RunFileError(f"cannot read {path}: {error.strerror}") from error


def read_parquet(path: Path) -> Any:
    """A ``pyarrow.Table``, as far as it is not absurdly larger than its file: a few bytes can claim gigabytes.

    Raises:
        RunFileError: it is no Parquet file, or too large.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    limit = unpack_limit(path.stat().st_size)
    batches, size = [], 0
    try:
        with pq.ParquetFile(path) as file:
            groups = [file.metadata.row_group(number) for number in range(file.num_row_groups)]
            check_unpacked(path, sum(group.total_byte_size for group in groups), limit)
            for batch in file.iter_batches(batch_size=_PARQUET_ROWS):
                batches.append(batch)
                size += batch.nbytes
                check_unpacked(path, size, limit)
            return pa.Table.from_batches(batches, file.schema_arrow)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise RunFileError(f"{path} is not a Parquet file: {brief(error)}") from None


def _read_csv(path: Path) -> Any:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    refuse_utf16(path)
    comments, stored, header = 0, {}, ""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for line in file:
            if not line.startswith("#"):
                header = line
                break
            comments += 1
            if line.startswith(_CSV_METADATA_LINE):
                key, _, value = line.removeprefix(_CSV_METADATA_LINE).strip().partition(": ")
                stored[f"hapticd.{key}"] = value
    # numpy writes the names behind a #
    behind = look(path, ",").names if comments and not set(header) & set("abcdf_") else None
    try:
        table = pacsv.read_csv(
            path,
            read_options=pacsv.ReadOptions(skip_rows=comments, column_names=behind, block_size=_CSV_BLOCK_BYTES),
            convert_options=pacsv.ConvertOptions(
                column_types={**dict.fromkeys(_FLOATS, pa.float64()), CSV_METADATA_COLUMN: pa.string()}
            ),
        )
    except (pa.ArrowException, OSError) as error:
        why = brief(error)
        # One column and rows with more: decimal commas, or a title, whose spaces separate no columns.
        hint = delimiter_hint([header.replace(" ", "")]) if "Expected 1 columns" in why else ""
        raise RunFileError(f"{path} is not a readable CSV file: {why}{hint and f'; {hint}'}") from None
    table = table.rename_columns([name.strip() for name in column_names(path, table)])
    if CSV_METADATA_COLUMN in table.column_names:
        if table.num_rows:
            found = mapping_of(table.column(CSV_METADATA_COLUMN)[0].as_py())
            stored |= {f"hapticd.{key}": json.dumps(value) for key, value in found.items()}
        table = table.drop_columns([CSV_METADATA_COLUMN])
    return table.replace_schema_metadata(stored or None)


def mapping_of(text: str | None) -> dict[str, Any]:
    """The JSON object that a text is; an empty one where it is none."""
    value = from_json(text or "")
    return value if isinstance(value, dict) else {}


_TABLES = {".csv": _read_csv, ".parquet": read_parquet, ".mcap": read_mcap}


def _check_names(path: Path, names: list[str]) -> None:
    if duplicates := sorted({name for name in names if names.count(name) > 1}):
        raise RunFileError(f"{path} has more than one column {', '.join(duplicates)}")
    missing = [" or ".join(choice) for choice in _NEEDED if not set(choice) & set(names)]
    if missing:
        has = ", ".join(names) or "none"
        hint = delimiter_hint(names) or _IMPORT
        raise RunFileError(f"{path} lacks the column(s) {'; '.join(missing)} (it has: {has}); {hint}")


def _column(path: Path, name: str, column: Any) -> NDArray[Any]:
    """Values of one column, known ones in their own type if that loses nothing."""
    from pyarrow import types

    is_number = types.is_integer(column.type) or types.is_floating(column.type)
    if is_number and column.num_chunks and not column.null_count:  # to_numpy would load pandas: 0.3 s and 50 MB
        values: NDArray[Any] = np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks])
    else:
        values = column.to_numpy()
    if name not in _FLOATS and name not in (ROW.names or ()):
        return values
    wanted = ROW[name] if name in (ROW.names or ()) else np.dtype(np.float64)
    if values.size and values.dtype.kind not in "iuf":
        raise RunFileError(f"{path}: column {name} holds {column.type}, not numbers")
    if wanted.kind == "i" and values.dtype.kind in "uf":
        _check_whole(path, name, values)
    with np.errstate(invalid="ignore"):  # a signalling NaN is none the less one
        converted: NDArray[Any] = values.astype(wanted)
    return converted


def _check_whole(path: Path, name: str, values: NDArray[Any]) -> None:
    rest = f"column {name} must hold whole numbers, none missing"
    values = values.astype(np.float64)  # a narrower type knows no 2⁶³
    if (bad := np.flatnonzero(values != np.rint(values))).size:
        raise RunFileError(
            f"{path}: {rest}; row {bad[0]} holds {values[bad[0]]:g}, and {bad.size} row(s) are not whole"
        )
    if (bad := np.flatnonzero(np.abs(values) >= _LARGEST)).size:
        raise RunFileError(f"{path}: {rest}; row {bad[0]} holds {values[bad[0]]:g}, more than the 64 bits of a counter")


def delimiter_hint(names: Iterable[str]) -> str:
    """What to do about a header that is one name with delimiters in it; nothing for any other header."""
    only = list(names)
    for sign, shown in _DELIMITERS:
        if len(only) == 1 and sign in only[0].strip():
            way = f"csv: {{delimiter: '{shown}'}} in its map"
            return f"its values are separated by '{shown}': 'hapticd import' reads it with {way}"
    return ""


def _texts(value: Any) -> dict[str, str]:
    """A mapping of texts to texts as far as it is one: a file may hold anything."""
    entries = value.items() if isinstance(value, dict) else ()
    return {key: text for key, text in entries if isinstance(text, str)}


def _standard_units(names: Iterable[str], metadata: dict[str, Any]) -> dict[str, str]:
    linear = bool(metadata.get("linear"))
    return {column.name: column.unit_for(linear=linear) for column in COLUMNS if column.name in names}
