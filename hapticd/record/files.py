"""Names of run files, the folder they go to, and how many of them stay there."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hapticd.figures.files import atomic_write
from hapticd.record.errors import RecordingError, RunExistsError, RunFileError
from hapticd.record.metadata import utc_now
from hapticd.record.writer import RunWriter

_LABEL_LENGTH = 64
_RUN_NAME = re.compile(r"(run|fault|crash)-\d{8}T\d{6}\.\d{3}Z(?:-[A-Za-z0-9_-]+)?\.arrow")
_KEPT_RUN_S, _KEPT_FAULT_S = 60.0, 86400.0
"""Since it was written last, a run file is not removed."""


def safe_label(label: str) -> str:
    """The label as a part of a file name: letters, digits, ``_`` and ``-``, at most 64 of them."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", label).strip("_")[:_LABEL_LENGTH]


def run_names(kind: str, label: str) -> Iterator[str]:
    """Names to try in turn: ``<kind>-<UTC time in ms>[-label].arrow``, then the same with ``-2``, ``-3`` and so on."""
    now = utc_now()
    stamp = f"{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z"
    stem = "-".join(part for part in (kind, stamp, safe_label(label)) if part)
    yield f"{stem}.arrow"
    for number in itertools.count(2):
        yield f"{stem}-{number}.arrow"


@contextlib.contextmanager
def written(target: Path) -> Iterator[Path]:
    """A file to write in the place of another; that one is there whole afterwards, or as it was.

    Raises:
        RunFileError: it cannot be written; nothing is left of it.
    """
    try:
        with atomic_write(target) as part:
            yield part
    except OSError as error:
        raise RunFileError(f"cannot write {target}: {error.strerror or error}") from error
    except RecordingError as error:
        # What a recording says of itself is of the scratch file, which is gone by now.
        cause = error.__cause__
        why = cause.strerror if isinstance(cause, OSError) and cause.strerror else str(error)
        raise RunFileError(f"cannot write {target}: {why}; nothing is left of it") from error


def why_unwritable(directory: Path) -> str | None:
    """Why no run can be written to a folder that may not be there yet; None where one can. Nothing is made."""
    existing = existing_place(directory)
    if not existing.is_dir():
        return f"{existing} is not a folder"
    return None if os.access(existing, os.W_OK | os.X_OK) else f"this user cannot write to {existing}"


def open_new_run(directory: Path, kind: str, label: str, metadata: Mapping[str, Any]) -> RunWriter:
    """Create a run file under a name that no other file has, and its folder if need be.

    Raises:
        RecordingError: the folder cannot be made or written to.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise RecordingError(f"record.directory {directory} is not a folder") from None
    except OSError as error:
        raise RecordingError(f"cannot make record.directory {directory}: {error.strerror}") from error
    for name in run_names(kind, label):
        with contextlib.suppress(RunExistsError):
            return RunWriter(directory / name, metadata)
    raise AssertionError("the names do not end")


def existing_place(directory: Path) -> Path:
    """The folder, or, where it is not there yet, the nearest one above it that is."""
    return next(place for place in (directory, *directory.parents) if place.exists())


@dataclass(frozen=True)
class Kept:
    """What is left of the run files in a folder.

    Attributes:
        size: of what is left, bytes.
        removed: what is gone, oldest first.
    """

    size: int
    removed: list[Path]


def remove_oldest(directory: Path, most: int, recording: Path | None, now: float | None = None) -> Kept:
    """Remove the oldest run files that a daemon of this user has made, until the rest is not larger than ``most``.

    A run file is a regular file of this user's with a name of `run_names`. Never removed: the one being recorded, one that
    was written to in the last minute (another daemon's may be), and what a fault or crash of the last day has left.

    Args:
        directory: where; no folder below it is looked at.
        most: bytes that may stay.
        recording: the file being written.
        now: seconds since the epoch, None for the clock's.
    """
    now = time.time() if now is None else now
    found = []
    with contextlib.suppress(FileNotFoundError), os.scandir(directory) as entries:
        for entry in entries:
            if (named := _RUN_NAME.fullmatch(entry.name)) and entry.is_file(follow_symlinks=False):
                with contextlib.suppress(FileNotFoundError):
                    found.append((entry.stat(follow_symlinks=False), named[1], directory / entry.name))
    found.sort(key=lambda run: (run[0].st_mtime, run[2].name))
    size, removed = sum(run[0].st_size for run in found), []
    for stat, kind, path in found:
        if size <= most:
            break
        untouched_s = _KEPT_FAULT_S if kind in ("fault", "crash") else _KEPT_RUN_S
        if path == recording or stat.st_uid != os.geteuid() or now - stat.st_mtime < untouched_s:
            continue
        with contextlib.suppress(OSError):
            path.unlink()
            size -= stat.st_size
            removed.append(path)
    return Kept(size, removed)
