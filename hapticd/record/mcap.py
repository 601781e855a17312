"""Runs as MCAP, which PlotJuggler and Foxglove open: one channel, CDR with a ROS 2 message definition, no ROS needed.

Every column is one field of eight bytes, so a message is the row behind the four bytes of the CDR header. ROS field names
are lower case; the run's own names, units, config and provenance are in the Metadata record ``hapticd``, as JSON a key.

Formats: https://mcap.dev/spec, https://mcap.dev/spec/registry (cdr, ros2msg), OMG DDS-XTypes 7.4 (XCDR1, little endian).
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.config.opening import open_regular
from hapticd.record.errors import RunFileError
from hapticd.record.metadata import decode_metadata, encode_metadata, versions
from hapticd.record.schema import COLUMNS
from hapticd.record.sizes import check_unpacked, unpack_limit

TOPIC: Final = "/hapticd/tick"
MESSAGE: Final = "hapticd_msgs/msg/Tick"
METADATA: Final = "hapticd"
LAYOUT: Final = Path(__file__).with_name("plotjuggler.xml")
"""A PlotJuggler layout for these files."""
_CDR_LITTLE_ENDIAN: Final = b"\x00\x01\x00\x00"
_TYPES: Final = {"i": ("int64", np.dtype("<i8")), "f": ("float64", np.dtype("<f8"))}
_KINDS: Final = dict(_TYPES.values())
_DESCRIPTIONS: Final = {column.name: column.description for column in COLUMNS}


def field_names(columns: Mapping[str, Any]) -> dict[str, str]:
    """ROS field names (lower case, a letter first, single ``_``), all different, for the run's columns."""

    def spelled(column: str) -> str:
        name = re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", column.lower())).strip("_")
        return name if re.match(r"[a-z]", name) else f"x{name}"

    return distinct(columns, spelled)


def distinct(names: Iterable[str], spelled: Callable[[str], str], longest: int = 255) -> dict[str, str]:
    """Names as another format spells them, all different, no longer than it takes."""
    found: dict[str, str] = {}
    for name in names:
        base = choice = spelled(name)[:longest]
        number = 2
        while choice in found.values():
            choice, number = base[: longest - len(ending := f"_{number}")] + ending, number + 1
        found[name] = choice
    return found


def definition(columns: Mapping[str, NDArray[Any]], units: Mapping[str, str]) -> str:
    """The ``ros2msg`` definition: a field a column, unit and meaning in its comment."""
    lines = ["# One servo tick of hapticd."]
    for column, field in field_names(columns).items():
        comment = "; ".join(part for part in (units.get(column), _DESCRIPTIONS.get(column)) if part)
        lines.append(f"{_type(column, columns[column])[0]} {field}" + (f"  # {comment}" if comment else ""))
    return "\n".join(lines) + "\n"


def write_mcap(
    columns: Mapping[str, NDArray[Any]], units: Mapping[str, str], metadata: Mapping[str, Any], file: BinaryIO
) -> None:
    """Write a run.

    Args:
        columns: name → values, (n,), whole or floating-point numbers. units: of those that have one.
        metadata: of the run; its ``created_utc`` is the time of the first row. file: open for writing.

    Raises:
        RunFileError: a column without numbers, or time stamps that are not finite.
    """
    from mcap.writer import CompressionType, Writer

    stamps = _stamps(columns["time_s"], metadata)
    messages = messages_of(columns)
    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library=f"hapticd {versions()['hapticd']}")
    text = definition(columns, units)
    schema = writer.register_schema(name=MESSAGE, encoding="ros2msg", data=text.encode())
    channel = writer.register_channel(topic=TOPIC, message_encoding="cdr", schema_id=schema)
    described = {"columns": list(columns), **metadata}
    writer.add_metadata(METADATA, {key.decode(): value.decode() for key, value in encode_metadata(described).items()})
    for number, (stamp, message) in enumerate(zip(stamps.tolist(), messages, strict=True)):
        writer.add_message(channel, stamp, message.tobytes(), stamp, number & 0xFFFFFFFF)
    writer.finish()  # type: ignore[no-untyped-call]


def read_mcap(path: Path) -> Any:
    """A run that `write_mcap` wrote, as a ``pyarrow.Table`` with the run's metadata.

    Raises:
        RunFileError: it is no MCAP file, is damaged, or holds no run of hapticd.
    """
    import pyarrow as pa
    from mcap.records import Channel, Message, Metadata, Schema

    schemas: dict[int, Schema] = {}
    channels: set[int] = set()
    found: list[bytes] = []
    stored: dict[str, str] | None = None
    for record in _records(path):
        if isinstance(record, Schema) and record.name == MESSAGE:
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.topic == TOPIC and record.schema_id in schemas:
            channels.add(record.id)
        elif isinstance(record, Message) and record.channel_id in channels:
            found.append(record.data)
        elif isinstance(record, Metadata) and record.name == METADATA:
            stored = record.metadata
    if stored is None or not channels:
        raise RunFileError(f"{path} is no recording of hapticd: it has no channel {TOPIC} with its description")
    metadata = decode_metadata({key.encode(): value.encode() for key, value in stored.items()})
    names, kinds = metadata.pop("columns", None), _kinds(next(iter(schemas.values())).data.decode(errors="replace"))
    named = isinstance(names, list) and len(names) == len(kinds) and all(isinstance(name, str) for name in names)
    width = len(_CDR_LITTLE_ENDIAN) + 8 * len(kinds)
    if not named or any(len(data) != width or data[:4] != _CDR_LITTLE_ENDIAN for data in found):
        raise RunFileError(f"{path} is damaged: its messages are not what its definition says")
    block = np.frombuffer(b"".join(data[4:] for data in found), dtype="<i8").reshape(len(found), len(kinds))
    columns = [np.ascontiguousarray(block[:, at]).view(kind) for at, kind in enumerate(kinds)]
    table = pa.table({name: pa.array(values) for name, values in zip(names, columns, strict=True)})
    return table.replace_schema_metadata(encode_metadata(metadata))


def _records(path: Path) -> Iterator[Any]:
    """Every record in order, chunks unpacked: what a chunk claims is checked first, as its packer believes it.

    Raises:
        RunFileError: it is no MCAP file, is damaged, or unpacks to too much.
    """
    import zstandard
    from mcap.exceptions import McapError
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    with open_regular(path) as file:
        data = file.read()
    limit, unpacked = unpack_limit(len(data)), 0
    try:
        reader = StreamReader(io.BytesIO(data), emit_chunks=True, validate_crcs=True, record_size_limit=len(data))
        for record in reader.records:
            if not isinstance(record, Chunk):
                yield record
                continue
            if record.compression not in ("", "zstd"):
                raise RunFileError(f"{path} is packed with {record.compression}; hapticd packs with zstd")
            claimed = zstandard.frame_content_size(record.data) if record.compression else len(record.data)
            unpacked += max(claimed, record.uncompressed_size)
            check_unpacked(path, unpacked, limit)
            yield from breakup_chunk(record, validate_crc=True)
    # A record that is shorter than it says ends in a struct.error.
    except (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError, EOFError) as error:
        raise RunFileError(f"{path} is not a readable MCAP file: {error or type(error).__name__}") from None


def _type(column: str, values: NDArray[Any]) -> tuple[str, np.dtype[Any]]:
    kind = "i" if values.dtype.kind in "iub" else values.dtype.kind
    if kind not in _TYPES:
        raise RunFileError(f"column {column} holds {values.dtype}, not numbers; MCAP takes numbers only")
    return _TYPES[kind]


def messages_of(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """The messages, shape (n, 4 + 8 · columns)."""
    rows = len(next(iter(columns.values())))
    block = np.empty((rows, len(_CDR_LITTLE_ENDIAN) + 8 * len(columns)), dtype=np.uint8)
    block[:, :4] = np.frombuffer(_CDR_LITTLE_ENDIAN, dtype=np.uint8)
    for at, (name, values) in enumerate(columns.items()):
        packed = np.ascontiguousarray(values, dtype=_type(name, values)[1])
        block[:, 4 + 8 * at : 12 + 8 * at] = packed.view(np.uint8).reshape(rows, 8)
    return block


def _stamps(time_s: NDArray[Any], metadata: Mapping[str, Any]) -> NDArray[np.uint64]:
    """Nanoseconds since 1970 of every row; since the first row where the run does not say when it began."""
    seconds = np.asarray(time_s, dtype=np.float64)
    if not np.all(np.isfinite(seconds)):
        raise RunFileError("time_s holds values that are not finite; an MCAP message has a time")
    try:
        begin = round(datetime.fromisoformat(str(metadata["created_utc"])).timestamp() * 1e9)
    except (KeyError, ValueError):
        begin = 0
    after = seconds - (seconds.min() if seconds.size else 0.0)
    return (begin + np.rint(after * 1e9).astype(np.int64)).astype(np.uint64)


def _kinds(text: str) -> list[np.dtype[Any]]:
    """Types of the fields of a definition, in order."""
    fields = [line.split("#")[0].split() for line in text.splitlines()]
    return [_KINDS[words[0]] for words in fields if len(words) == 2 and words[0] in _KINDS]
