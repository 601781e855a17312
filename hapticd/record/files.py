"""Names of run files and the folder they go to."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hapticd.figures.files import atomic_write
from hapticd.record.errors import RecordingError, RunExistsError, RunFileError
from hapticd.record.metadata import utc_now
from hapticd.record.writer import RunWriter

_LABEL_LENGTH = 64


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


def refuse_existing(target: Path, *, force: bool, source: Path | None = None) -> None:
    """Refuse to replace a file.

    Raises:
        RunFileError: it exists, and ``force`` is not given; or it is ``source``, which is read.
    """
    if source is not None and _is_same(source, target):
        raise RunFileError(f"{target} is the file that is read; give another name")
    if target.exists() and not force:
        raise RunFileError(f"{target} exists; give another name, or --force to replace it")


def _is_same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:  # one of them is not there
        return False


@contextlib.contextmanager
def written(target: Path) -> Iterator[Path]:
    """A file to write in the place of another; that one is there whole afterwards, or as it was.

    Raises:
        RunFileError: it cannot be written.
    """
    try:
        with atomic_write(target) as part:
            yield part
    except OSError as error:
        raise RunFileError(f"cannot write {target}: {error.strerror or error}") from error


def why_unwritable(directory: Path) -> str | None:
    """Why no run can be written to a folder that may not be there yet; None where one can. Nothing is made."""
    existing = next(place for place in (directory, *directory.parents) if place.exists())
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
