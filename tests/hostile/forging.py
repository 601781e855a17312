"""Files that are well formed and lie: right checksums and headers around columns, notes and sizes that nobody expects."""

from __future__ import annotations

import io
import json
import math
import random
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy.io import savemat

from hapticd.record.metadata import run_metadata
from hapticd.record.stream import (
    CHECK,
    END_OF_STREAM,
    EVENTS,
    FIRST_ROW,
    METADATA_CHECK,
    TOTAL,
    checksum,
    metadata_checksum,
)
from hapticd.record.writer import arrow_schema

_COLUMNS = (
    "tick", "time_s", "encoder_counts", "position", "current_command_A", "force", "ticks", "flags", "t", "x", "i",
)  # fmt: skip
_NAMES = (*_COLUMNS, "", " ", "a\nb", "\x1b[31m", "µ", "x" * 3000, "time_s ")
_NUMBERS = (0, 1, -1, 2**31, 2**53 + 1, 2**63 - 1, -(2**63), 10**400, 0.5, 1e308, -1e308, 5e-324, math.nan, math.inf)
_TEXTS = ("", "x", "\x1b[31m", "9" * 5000, "{}", "[]", "null", "NaN", "1e999", '{"a": 1', "\0")
_TEXTS += ("[" * 90 + "]" * 90, "[" * 400 + "]" * 400, "[" * 3000, "[" * 100_000)
_KEYS = (
    "config", "model", "units", "events", "linear", "kind", "label", "host", "versions", "truncated", "created_utc",
    "columns",
)  # fmt: skip


def _values(chance: random.Random, rows: int) -> NDArray[Any]:
    kind = chance.choice(("f8", "i8", "f8", "i8", "f4", "f2", "u8", "i1", "u1", "?", ">f8", ">i4"))
    special = chance.choice((0, 1, -1, 2**31, 1e308, float("nan"), float("inf"), 0.5))
    values = np.linspace(0.0, 1.0, rows) if chance.random() < 0.7 else np.full(rows, special)
    with np.errstate(all="ignore"):
        return values.astype(kind)


def _plain(chance: random.Random, depth: int = 0) -> Any:
    """Any JSON value."""
    what = chance.randrange(7 if depth < 3 else 4)
    if what < 2:
        return chance.choice(_NUMBERS[:7])
    if what < 4:
        return chance.choice((None, True, False, *_TEXTS[:4]))
    if what == 4:
        return [_plain(chance, depth + 1) for _ in range(chance.randrange(4))]
    return {
        chance.choice((*_KEYS, *_COLUMNS, "row", "event")): _plain(chance, depth + 1)
        for _ in range(chance.randrange(4))
    }


def _json(chance: random.Random) -> str:
    """JSON, or what looks like it."""
    return chance.choice(_TEXTS) if chance.random() < 0.4 else json.dumps(_plain(chance))


def _described(chance: random.Random, prefix: str = "hapticd.") -> dict[str, str]:
    return {f"{prefix}{key}": _json(chance) for key in chance.sample(_KEYS, chance.randrange(1, 5))}


def _foreign(chance: random.Random, rows: int) -> Any:
    """An Arrow array of a type that no run has."""
    return chance.choice(
        (
            lambda: pa.array(["a" * 100] * rows),
            lambda: pa.array(["x"] * rows).dictionary_encode(),
            lambda: pa.nulls(rows),
            lambda: pa.array([[1, 2]] * rows),
            lambda: pa.array([{"a": 1}] * rows),
            lambda: pa.array([b"x"] * rows, pa.binary(1)),
            lambda: pa.array([None] * rows, pa.float64()),
            lambda: pa.array([0] * rows, pa.timestamp("ns")),
            lambda: pa.array([0] * rows, pa.duration("s")),
            lambda: pa.array([None] * rows, pa.decimal128(5, 2)),
            lambda: pa.array([True] * rows),
            lambda: pa.RunEndEncodedArray.from_arrays(pa.array([max(rows, 1)], pa.int32()), pa.array([1.0])),
        )
    )()


def _batch(chance: random.Random, rows: int) -> Any:
    names, arrays = [], []
    for name in (*_COLUMNS[:5], *(chance.choice(_NAMES) for _ in range(chance.randrange(3)))):
        if chance.random() < 0.1:
            continue
        array = _foreign(chance, rows) if chance.random() < 0.1 else pa.array(_native(_values(chance, rows)))
        if len(array) == rows:
            names.append(name)
            arrays.append(array)
    return pa.RecordBatch.from_arrays(arrays, names) if arrays else pa.RecordBatch.from_pydict({"time_s": [0.0] * rows})


def _native(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(values.dtype.newbyteorder("="))


def run_file(chance: random.Random) -> bytes:
    """An Arrow stream: of version 2 with right checksums, of version 1, or of neither; sometimes compressed."""
    if chance.random() < 0.4:
        return _checked_run(chance)
    batches = [_batch(chance, rows) for rows in chance.sample((0, 1, 5, 40), chance.randrange(1, 3))]
    schema = batches[0].schema.with_metadata(
        {"hapticd.format_version": chance.choice(("1", "2", "x")), **_described(chance)}
    )
    if chance.random() < 0.5:
        schema = schema.with_metadata({**schema.metadata, METADATA_CHECK: metadata_checksum(schema)})
    sink = io.BytesIO()
    options = pa.ipc.IpcWriteOptions(compression=chance.choice((None, None, None, "lz4", "zstd")))
    with pa.ipc.new_stream(sink, schema, options=options) as stream:
        for batch in batches:
            if batch.schema.equals(schema.remove_metadata()):
                notes = {EVENTS.decode(): _json(chance), CHECK.decode(): _json(chance)[:8]}
                stream.write_batch(batch.replace_schema_metadata(schema.metadata), custom_metadata=notes)
    return sink.getvalue()


def _checked_run(chance: random.Random) -> bytes:
    schema = arrow_schema(run_metadata())
    stored = {**schema.metadata, **{key.encode(): text.encode() for key, text in _described(chance).items()}}
    schema = schema.with_metadata({key: value for key, value in stored.items() if key != METADATA_CHECK})
    schema = schema.with_metadata({**schema.metadata, METADATA_CHECK: metadata_checksum(schema)})
    sink = io.BytesIO()
    with pa.ipc.new_stream(sink, schema) as stream:
        row = 0
        for rows in (chance.choice((0, 1, 5)), 3, 0):
            values = [np.zeros(rows, field.type.to_pandas_dtype()) for field in schema]
            for column in values:
                column[...] = chance.choice((0, 1, -1, 2**62, -(2**63)))
            notes = {FIRST_ROW: chance.choice((b"%d" % row, b"%d" % row, b"%d" % 2**62, b"9" * 30, b"-1", b"x"))}
            if chance.random() < 0.5:
                notes[EVENTS] = _json(chance).encode()
            if chance.random() < 0.5:
                notes[TOTAL] = chance.choice((b"%d" % row, b"%d" % 2**62, b""))
            notes[CHECK] = checksum(notes, values)
            stream.write_batch(
                pa.RecordBatch.from_arrays([pa.array(v) for v in values], schema=schema), custom_metadata=notes
            )
            row += rows
    return sink.getvalue()[: -len(END_OF_STREAM) if chance.random() < 0.3 else None]


def parquet_file(chance: random.Random) -> bytes:
    """A Parquet file with odd columns, metadata and codecs; sometimes one that unpacks to very much."""
    if chance.random() < 0.05:
        rows = 1 << 20
        table = pa.table(
            {name: np.zeros(rows) for name in _COLUMNS[:5]}
            | {"s": pa.array(["x" * 50]).take(pa.array(np.zeros(rows, int)))}
        )
    else:
        batch = _batch(chance, chance.choice((0, 1, 5, 40)))
        table = pa.Table.from_batches([batch]).replace_schema_metadata(_described(chance))
    sink = io.BytesIO()
    try:
        pq.write_table(table, sink, compression=chance.choice(("none", "snappy", "gzip", "zstd", "lz4", "brotli")))
    except (pa.ArrowException, ValueError, TypeError):
        pq.write_table(pa.table({"time_s": [0.0]}), sink)
    return sink.getvalue()


def csv_file(chance: random.Random) -> bytes:
    """A table as text, with a description that is not what it should be."""
    lines = [f"# hapticd {key}: {text}".replace("\n", " ") for key, text in _described(chance, "").items()]
    names = [name for name in (*_COLUMNS[:5], chance.choice(_NAMES)) if chance.random() < 0.95]
    lines.append(",".join(chance.choice((name, f'"{name}"')) for name in names))
    for row in range(chance.choice((0, 1, 5, 40))):
        cells = [str(chance.choice(_NUMBERS)) if chance.random() < 0.1 else str(row) for _ in names]
        lines.append(chance.choice((",", ",", ",", ";")).join(cells))
    return "\n".join(lines).encode(errors="replace")


def npy_file(chance: random.Random) -> bytes:
    """An array whose header claims another shape or type than it has."""
    sink = io.BytesIO()
    rows = chance.choice((0, 1, 5, 40))
    array = np.stack([_native(_values(chance, rows)).astype(float) for _ in range(3)], axis=chance.choice((0, 1)))
    with np.errstate(all="ignore"):
        array = array.astype(chance.choice(("<f8", ">f8", "<i8", "<f4", "<c16", "S3", "M8[ns]")))
    np.lib.format.write_array(sink, array)
    data = sink.getvalue()
    shape = chance.choice(
        ("(4611686018427387904, 4)", "(-1, 3)", "()", "(3,)", "((3,),)", "(True, 3)", "(10**9, 3)", "(3.0, 1)")
    )
    kind = chance.choice(
        ("'<f8'", "'|O'", "'<U99999999'", "[('a', '<f8', (1000000000,))]", "'<f8,'", "{}", "'<M8[x]'", "'V0'")
    )
    header = f"{{'descr': {kind}, 'fortran_order': {chance.choice(('False', 'True', '3'))}, 'shape': {shape}, }}"
    if chance.random() < 0.6:
        text = header.ljust(117) + "\n"
        data = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + data[128:]
    return data


def mat_file(chance: random.Random) -> bytes:
    """A MATLAB file of structs, cells, texts, sparse and empty arrays; sometimes one that unpacks to very much."""
    rows = chance.choice((0, 1, 5, 40))
    contents: dict[str, Any] = {
        name: _native(_values(chance, rows)) for name in ("t", "x", "i") if chance.random() < 0.9
    }
    contents |= chance.choice(
        (
            dict,
            lambda: {"s": {"t": np.zeros(3), "n": {"x": "text"}}},
            lambda: {"c": np.array([np.zeros(2), "x"], dtype=object)},
            lambda: {"z": np.zeros((0, 5)), "text": "x" * 50},
            lambda: {"x": np.ones((3, rows)) + 1j},
            lambda: {"big": np.zeros(1 << 22)} if chance.random() < 0.2 else {},
        )
    )()
    sink = io.BytesIO()
    savemat(
        sink,
        contents or {"t": 1.0},
        do_compression=chance.random() < 0.5,
        format=chance.choice(("5", "5", "4")) if not _nested(contents) else "5",
    )
    return sink.getvalue()


def _nested(contents: Mapping[str, Any]) -> bool:
    return any(
        isinstance(value, dict) or getattr(value, "dtype", None) in (object, bool) for value in contents.values()
    )
