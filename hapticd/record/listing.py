"""Recordings in folders: the list of them, and ``@last``.

A run file tells its rows only batch by batch, so counting them reads every batch's header, never its rows.
"""

from __future__ import annotations

import bisect
import re
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hapticd.config.opening import open_regular
from hapticd.record.errors import RunFileError
from hapticd.record.metadata import decode_metadata
from hapticd.record.stream import END_OF_STREAM, events_of, refuse_compressed

SUFFIX = ".arrow"
LAST = "@last"
FAULT = "fault-"
"""How the recorder names the seconds before a fault; ``@last`` means a run."""
_NOTED = ("note", "marker")
_LAST = re.compile(r"@last(?:~(\d+))?")


@dataclass(frozen=True)
class Listed:
    """One recording as a list shows it.

    Attributes:
        path: the file. modified: when it was last written to. size: bytes.
        kind: ``run``, ``history``, … as the recorder calls it; None where the file does not say.
        label: what was recorded. rows, duration_s: None where it cannot be read.
        whole: it was ended properly.
        subject, condition: of its config.
        sequence: of which it is a step: its name.
        notes: notes and markers in it, each with ``after_s``, the time since its first row.
        error: why it cannot be read, in words.
    """

    path: Path
    modified: datetime
    size: int
    kind: str | None = None
    label: str | None = None
    rows: int | None = None
    duration_s: float | None = None
    whole: bool = False
    subject: str | None = None
    condition: str | None = None
    sequence: str | None = None
    notes: tuple[dict[str, Any], ...] = ()
    error: str | None = None


def run_paths(folders: Iterable[Path]) -> list[Path]:
    """Run files of some folders, the newest first; what is not there or may not be read is passed over."""
    found: dict[Path, int] = {}
    for folder in folders:
        try:
            entries = [path for path in folder.iterdir() if path.suffix == SUFFIX and not path.name.startswith(".")]
        except OSError:
            continue
        for path in entries:
            try:
                found[path] = path.stat().st_mtime_ns
            except OSError:  # removed meanwhile
                continue
    # Two files of one instant: the recorder's names rise with time.
    return sorted(found, key=lambda path: (found[path], path.name), reverse=True)


def last_runs(paths: Iterable[Path]) -> list[Path]:
    """What ``@last``, ``@last~1`` and so on stand for, of :func:`run_paths`: runs, not what was kept before a fault."""
    return [path for path in paths if not path.name.startswith(FAULT)]


def resolve_run(name: str | Path, folders: Sequence[Path]) -> Path:
    """The file that a run's name stands for.

    Args:
        name: a path; ``@last``, the newest run, and ``@last~1``, the one before it; or the bare name of a recording.
        folders: where recordings are.

    Raises:
        RunFileError: there are not so many recordings.
    """
    text = str(name)
    if text.startswith("@") and not Path(text).exists():
        wanted = _LAST.fullmatch(text)
        if wanted is None:
            raise RunFileError(f"{text}: the newest recording is {LAST}, the one before it {LAST}~1")
        back, paths = int(wanted[1] or 0), last_runs(run_paths(folders))
        if back >= len(paths):
            places = " or ".join(map(str, folders)) or "no folder"
            raise RunFileError(f"{text}: {len(paths)} recording(s) in {places}; 'hapticd runs' lists them")
        return paths[back]
    path = Path(text)
    if path.name == text and not path.exists():
        return next((folder / text for folder in folders if (folder / text).exists()), path)
    return path


def listed(path: Path) -> Listed:
    """What a recording says of itself; never raises for a file that is none."""
    try:
        stat = path.stat()
    except OSError as error:
        return Listed(path, datetime.fromtimestamp(0, UTC), 0, error=error.strerror)
    known: dict[str, Any] = {"modified": datetime.fromtimestamp(stat.st_mtime, UTC), "size": stat.st_size}
    import pyarrow as pa

    try:
        open_regular(path).close()
    except OSError as error:
        return Listed(path, **known, error=error.strerror)
    try:
        with pa.memory_map(str(path)) as source:
            return Listed(path, **known, **_described(source))
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = "empty" if stat.st_size == 0 else str(error).splitlines()[0]
        return Listed(path, **known, error=f"no run file: {reason}")


def config_of(path: Path) -> dict[str, Any]:
    """The config in a run file's description; empty where it has none or cannot be read."""
    import pyarrow as pa

    try:
        open_regular(path).close()
        with pa.memory_map(str(path)) as source:
            found = decode_metadata(pa.ipc.open_stream(source).schema.metadata).get("config")
    except (pa.ArrowException, OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _described(source: Any) -> dict[str, Any]:
    import pyarrow as pa

    data = source.read_buffer()  # mapped: no row is read for it
    reader, view = pa.BufferReader(data), memoryview(data).cast("B")
    stream = pa.ipc.open_stream(reader)
    metadata = decode_metadata(stream.schema.metadata)
    rows, whole = 0, False
    begins: list[int] = []
    stamps: list[Any] = []
    notes: list[dict[str, Any]] = []
    try:
        while True:
            refuse_compressed(view, reader.tell())
            batch, said = stream.read_next_batch_with_custom_metadata()
            notes += [event for event in events_of(dict(said or {})) if event.get("event") in _NOTED]
            if batch.num_rows:
                stamps.append(batch.column("time_s"))
                begins.append(rows)
                rows += batch.num_rows
    except StopIteration:
        whole = view[-len(END_OF_STREAM) :] == END_OF_STREAM
    except (pa.ArrowException, OSError, KeyError, ValueError, struct.error):
        pass  # cut short, or being written: what came before counts

    def after_s(row: Any) -> float | None:
        """From the first row to another, or the last."""
        if not begins:
            return None
        row = min(max(row, 0), rows - 1) if isinstance(row, int) else 0
        at = bisect.bisect_right(begins, row) - 1
        return _duration(stamps[0][0].as_py(), stamps[at][row - begins[at]].as_py())

    sequence = metadata.get("sequence")
    named = (metadata.get("config") or {}).get("record")
    named = named if isinstance(named, dict) else {}
    return {
        "kind": _text(metadata.get("kind") or metadata.get("source")),
        "label": _text(metadata.get("label")),
        "rows": rows,
        "duration_s": after_s(rows),
        "whole": whole,
        "subject": _text(named.get("subject")),
        "condition": _text(named.get("condition")),
        "sequence": _text(sequence.get("name")) if isinstance(sequence, dict) else None,
        "notes": tuple({**event, "after_s": after_s(event.get("row"))} for event in notes),
    }


def _duration(first: Any, last: Any) -> float | None:
    numbers = isinstance(first, float | int) and isinstance(last, float | int)
    return float(last) - float(first) if numbers else None


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value else None
