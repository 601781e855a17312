"""The batches of a run file, each checked before it is trusted, and what is left of a file that is damaged.

Version 2 keeps with each batch the number of its first row and a CRC-32 over its values and notes; a CRC-32 of the metadata
with the schema; and the number of all rows with the last, empty batch. A batch that does not match, or
that cannot be decoded, is left out, and reading goes on at the next message that matches. Version 1 has none of this.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.record.errors import RunFileError

END_OF_STREAM = b"\xff\xff\xff\xff\x00\x00\x00\x00"
EVENTS, FIRST_ROW, CHECK, TOTAL = b"hapticd.events", b"hapticd.first_row", b"hapticd.crc32", b"hapticd.rows"
METADATA_CHECK = b"hapticd.metadata_crc32"
CHECKED_VERSION = 2
FORMAT_VERSION = 2

_MARK = END_OF_STREAM[:4]
_MOST_SEARCHES = 1000
_DEEPEST = 100


@dataclass(frozen=True)
class Damage:
    """Rows that are lost: from ``first_row`` up to, not including, ``end_row``; None: nobody knows how many."""

    first_row: int
    end_row: int | None

    def __str__(self) -> str:
        """In words."""
        if self.end_row is None:
            return f"rows from {self.first_row} on"
        return f"rows {self.first_row} to {self.end_row - 1}"


@dataclass
class Stream:
    """What a file holds.

    Attributes:
        schema: ``pyarrow.Schema``.
        batches: ``pyarrow.RecordBatch`` in order, those that could be trusted.
        events: as the batches carry them.
        whole: whether the file ends as it should.
        version: of the file; 0 for a stream that is not ours.
        damage: rows that are lost though the file goes on after them.
        metadata_damaged: whether metadata, units or names are not what was written.
    """

    schema: Any
    batches: list[Any] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    whole: bool = False
    version: int = 0
    damage: list[Damage] = field(default_factory=list)
    metadata_damaged: bool = False

    @property
    def rows(self) -> int:
        """Rows that can be read."""
        return sum(batch.num_rows for batch in self.batches)

    @property
    def checked(self) -> bool:
        """Whether there are checksums."""
        return self.version >= CHECKED_VERSION

    @property
    def damage_text(self) -> list[str]:
        """What contradicts what was written, in words; nothing for a file that is as it was, or cut at its end."""
        text = [f"{damage} do not match their checksum" for damage in self.damage]
        metadata = "its description (config, units, names) does not match its checksum"
        return [*text, metadata] if self.metadata_damaged else text


def checksum(notes: Mapping[bytes, bytes], columns: Iterable[NDArray[Any]]) -> bytes:
    """CRC-32 of a batch as text: its other notes in the order of their names, then its columns one after the other."""
    check = _notes_checksum(notes, CHECK)
    for column in columns:
        check = zlib.crc32(np.ascontiguousarray(column).tobytes(), check)
    return b"%08x" % check


def metadata_checksum(schema: Any) -> bytes:
    """CRC-32 of a schema as text: its metadata, and name, type and metadata of every field."""
    check = _notes_checksum(schema.metadata or {}, METADATA_CHECK)
    for column in schema:
        check = zlib.crc32(f"{column.name};{column.type};{column.nullable};".encode(errors="replace"), check)
        check = _notes_checksum(column.metadata or {}, METADATA_CHECK, check)
    return b"%08x" % check


def _notes_checksum(notes: Mapping[bytes, bytes], without: bytes, check: int = 0) -> int:
    for key, value in sorted(notes.items()):
        if key != without:
            check = zlib.crc32(b"%d;%d;" % (len(key), len(value)) + key + value, check)
    return check


def read_stream(path: Path, data: bytes) -> Stream:
    """Every batch that can be trusted.

    Args:
        path: for messages.
        data: the file.

    Raises:
        RunFileError: it is no Arrow stream, one of a newer format, or one whose columns are neither numbers nor text.
    """
    import pyarrow as pa

    try:
        message = pa.ipc.read_message(pa.py_buffer(data))
        if message.type != "schema":  # pyarrow would take any message for one, and read beyond its end
            raise ValueError(f"it begins with a message of type {message.type!r}")
        schema = pa.ipc.read_schema(message)
        plain = all(_plain(column.type) for column in schema)
        stored = dict(schema.metadata or {})
        check = metadata_checksum(schema)
    except (pa.ArrowException, OSError, EOFError, UnicodeDecodeError, ValueError) as error:
        raise RunFileError(f"{path} is not a run file (no Arrow stream: {brief(error)})") from None
    if not plain:
        raise RunFileError(f"{path} is not a run file: it holds columns that are neither numbers nor text")
    found = Stream(schema, version=_version(stored))
    if found.version >= CHECKED_VERSION:
        found.metadata_damaged = stored.get(METADATA_CHECK) != check
        if found.version > FORMAT_VERSION and not found.metadata_damaged:
            raise RunFileError(
                f"{path} is a run file of format {found.version}, and this hapticd reads up to {FORMAT_VERSION}: "
                "install the hapticd that wrote it, or a newer one"
            )
        _take_checked(found, data)
    else:
        for batch, notes in _batches(found, data):
            found.batches.append(batch)
            found.events += events_of(notes)
    return found


def _take_checked(found: Stream, data: bytes) -> None:
    row, total = 0, None
    for batch, notes in _batches(found, data):
        if not _matches(batch, notes) or (first_row := _number(notes, FIRST_ROW)) is None or first_row < row:
            continue
        if first_row > row:
            found.damage.append(Damage(row, first_row))
        total = _number(notes, TOTAL)
        found.batches.append(batch)
        found.events += events_of(notes)
        row = first_row + batch.num_rows
    if found.whole and total != row:
        found.damage.append(Damage(row, total if total is not None and total > row else None))


def _batches(found: Stream, data: bytes) -> Iterator[tuple[Any, Mapping[bytes, bytes]]]:
    """Batches with their notes, in order; in a checked file, after one that cannot be decoded, on from the next that can."""
    import pyarrow as pa

    head = found.schema.serialize().to_pybytes()
    stream_data, before = data, 0
    for _ in range(_MOST_SEARCHES):
        source = pa.BufferReader(stream_data)
        here = 0
        try:
            stream = pa.ipc.open_stream(source)
            while True:
                here = before + source.tell()
                refuse_compressed(data, here)
                batch, notes = stream.read_next_batch_with_custom_metadata()
                batch.validate(full=True)
                yield batch, dict(notes or {})
        except StopIteration:
            found.whole = data.endswith(END_OF_STREAM) and here + len(END_OF_STREAM) >= len(data)
        except (pa.ArrowException, OSError, ValueError, struct.error):
            pass
        if found.whole or found.version < CHECKED_VERSION or (at := _next_message(data, here + 8)) is None:
            return
        stream_data, before = head + data[at:], at - len(head)


def _next_message(data: bytes, begin: int) -> int | None:
    """Where the next batch, or the end mark, may begin."""
    import pyarrow as pa

    buffer = pa.py_buffer(data)
    at = data.find(_MARK, begin)
    while 0 <= at <= len(data) - len(END_OF_STREAM):
        if at == len(data) - len(END_OF_STREAM) and data.endswith(END_OF_STREAM):
            return at
        size = int.from_bytes(data[at + 4 : at + 8], "little", signed=True)
        if at % 8 == 0 and 0 < size < len(data) - at:
            with contextlib.suppress(pa.ArrowException, OSError):
                if pa.ipc.read_message(buffer.slice(at)).type == "record batch":
                    return at
        at = data.find(_MARK, at + 1)
    return None


def refuse_compressed(data: bytes | memoryview, at: int) -> None:
    """Refuse a batch whose values are compressed: run files never are, and a few bytes could claim gigabytes.

    Reads Arrow's ``Message`` and ``RecordBatch`` (format/Message.fbs) as far as their vtables.

    Raises:
        ValueError: it is.
        struct.error: it is no message.
    """
    if data[at : at + 4] != _MARK or data[at : at + 8] == END_OF_STREAM:
        return
    message = at + 8 + struct.unpack_from("<I", data, at + 8)[0]
    header = _field(data, message, 2)
    if header and _field(data, header + struct.unpack_from("<I", data, header)[0], 3):
        raise ValueError("compressed values")


def _field(data: bytes | memoryview, table: int, number: int) -> int:
    """Where a field of a flatbuffer's table lies; 0: it is not set."""
    vtable = table - int(struct.unpack_from("<i", data, table)[0])
    if vtable < 0 or 4 + 2 * number >= struct.unpack_from("<H", data, vtable)[0]:
        return 0
    offset = int(struct.unpack_from("<H", data, vtable + 4 + 2 * number)[0])
    return table + offset if offset else 0


def _matches(batch: Any, notes: Mapping[bytes, bytes]) -> bool:
    import pyarrow as pa

    if any(column.null_count or column.type not in (pa.int64(), pa.float64()) for column in batch.columns):
        return False
    return notes.get(CHECK) == checksum(notes, (np.from_dlpack(column) for column in batch.columns))


def _plain(kind: Any) -> bool:
    """Types whose values take room in the file: a column of another kind could claim rows without having bytes for them."""
    from pyarrow import types

    kinds = (types.is_integer, types.is_floating, types.is_boolean, types.is_string, types.is_large_string)
    return any(is_kind(kind) for is_kind in (*kinds, types.is_temporal, types.is_decimal))


def _version(stored: Mapping[bytes, bytes]) -> int:
    """Of the file; that there is a checksum tells it where the number itself is damaged."""
    number = _number(stored, b"hapticd.format_version") or 0
    return max(number, CHECKED_VERSION) if METADATA_CHECK in stored else number


def _number(notes: Mapping[bytes, bytes], key: bytes) -> int | None:
    text = notes.get(key, b"")
    return int(text) if text.isdigit() and len(text) < 19 else None


def events_of(notes: Mapping[bytes, bytes]) -> list[dict[str, Any]]:
    """What a batch's custom metadata says has happened before its rows."""
    return mappings(from_json(notes.get(EVENTS, b"[]").decode(errors="replace")))


def from_json(text: str) -> Any:
    """A JSON value; text that is none, is nested too deeply or holds an endless number comes back as it is."""
    if text.count("[") + text.count("{") > _DEEPEST:
        steps = (1 if sign in "[{" else -1 if sign in "]}" else 0 for sign in text)
        if max(itertools.accumulate(steps)) > _DEEPEST:
            return text
    try:
        return json.loads(text)
    except ValueError:
        return text


def mappings(value: Any) -> list[dict[str, Any]]:
    """Those entries of a list that are mappings: a file may hold anything."""
    return [entry for entry in value if isinstance(entry, dict)] if isinstance(value, list) else []


def brief(error: Exception) -> str:
    """First line of what an error says."""
    return str(error).splitlines()[0] if str(error) else type(error).__name__
