"""Write rows to an Arrow IPC stream that stays readable whatever ends the process.

Batches are encoded in memory and handed to the kernel whole, at least every `FLUSH_S` seconds: what the kernel has, a
SIGKILL cannot take back, and `RunWriter.sync` has the disk take it. A batch that does not fit on the disk is cut off again,
so the file ends on a whole batch. All is appended: a file that somebody has cut stays shorter than what was written, and
`RunWriter.lost` sees it. Checksums: `hapticd.record.stream`.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import stat
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.record.errors import RecordingError, RunExistsError
from hapticd.record.metadata import encode_metadata, run_metadata, to_plain
from hapticd.record.schema import COLUMNS, ROW, Rows, check_rows, empty_rows
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

FLUSH_S = 0.1
BATCH_ROWS = 1024
_NO_DISK = {errno.EINVAL, errno.EROFS, errno.EBADF}
"""Of a file that cannot be synced (a pipe), and of one that was closed meanwhile."""
_DISK_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


class RunWriter:
    """A run file being written. Not thread-safe; the recorder serialises its calls.

    Also a context manager: leaving the block on an exception keeps the rows but leaves the end mark out, so that
    readers report the run as cut short.

    Args:
        path: the file to create; its folder must exist.
        metadata: see `metadata.run_metadata`; what is left out is filled in.

    Raises:
        RunExistsError: the file exists.
        RecordingError: it cannot be created.
    """

    def __init__(self, path: str | Path, metadata: Mapping[str, Any]) -> None:
        self.path = Path(path)
        self.rows_written = 0
        self._schema = arrow_schema(run_metadata(**metadata))
        self._pending: list[Rows] = []
        self._pending_rows = 0
        self._events: list[Any] = []
        self._last_flush = time.monotonic()
        self._size = 0
        self._open = self._has_identity = True
        self._failure: RecordingError | None = None
        self._sync_error: OSError | None = None
        try:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC
            self._fd = os.open(self.path, flags, 0o666)
        except FileExistsError:
            raise RunExistsError(f"{self.path} exists: a recording never overwrites a file") from None
        except OSError as error:
            raise RecordingError(f"cannot create {self.path}: {error.strerror}") from error
        # Some network file systems number a path and an open file differently.
        self._has_identity = self.lost() is None
        import pyarrow as pa

        self._staging = io.BytesIO()
        self._encoder = pa.ipc.new_stream(self._staging, self._schema)
        try:
            # Arrow holds the schema back until the first batch: an empty one makes the file readable from here on.
            self._write_batch(empty_rows())
        except RecordingError:
            # Without even its schema the file is nothing that a reader could use.
            os.close(self._fd)
            self.path.unlink(missing_ok=True)
            raise

    @property
    def rows(self) -> int:
        """Rows accepted so far, on disk or waiting for the next batch."""
        return self.rows_written + self._pending_rows

    @property
    def size(self) -> int:
        """Bytes handed to the kernel so far."""
        return self._size

    def lost(self) -> str | None:
        """What somebody has done to the file behind our back; None where it is at its path, as it was written."""
        here = os.fstat(self._fd)
        if here.st_nlink == 0:
            return "was deleted"
        if here.st_size < self._size:
            return f"was cut to {here.st_size} of {self._size} bytes"
        if here.st_size > self._size:
            return f"was written to by somebody else: {here.st_size} bytes instead of {self._size}"
        try:
            there = self.path.stat()
        except OSError as error:
            return f"cannot be reached at its path any more ({error.strerror})"
        return (
            "is not the file at its path any more" if self._has_identity and not os.path.samestat(here, there) else None
        )

    def abandon(self) -> tuple[Rows, list[dict[str, Any]]]:
        """Close the file as it is, without an end mark; the rows and events that were accepted and are not in it."""
        rows = np.concatenate(self._pending) if self._pending else empty_rows()
        events = [{key: value for key, value in event.items() if key != "row"} for event in self._events]
        self._failure = self._failure or RecordingError(f"{self.path} was given up")
        with contextlib.suppress(RecordingError):
            self.close()
        return rows, events

    def write(self, rows: Rows) -> None:
        """Append rows (copied) and write a batch when one is due; call it with no rows, too, to keep time.

        Raises:
            RecordingError: the disk is full or failed; the file ends on its last whole batch and takes no more rows.
            TypeError: the rows are not of `schema.ROW`.
        """
        check_rows(rows)
        self._check_open()
        if rows.size >= BATCH_ROWS:
            self.flush()
            for start in range(0, rows.size, BATCH_ROWS):
                self._write_batch(rows[start : start + BATCH_ROWS])
            return
        if rows.size:
            self._pending.append(rows.copy())
            self._pending_rows += rows.size
        if self._pending_rows >= BATCH_ROWS or time.monotonic() - self._last_flush >= FLUSH_S:
            self.flush()

    def annotate(self, event: Mapping[str, Any]) -> None:
        """Keep an event of the run (a changed setting, lost rows) with the rows, as ``row`` the number of the next row.

        Events go into the custom metadata of the next batch, because a stream's schema cannot change once written.
        """
        self._check_open()
        self._events.append(to_plain({"row": self.rows, **event}))

    def flush(self) -> None:
        """Hand what is pending to the kernel now.

        Raises:
            RecordingError: as in `write`.
        """
        self._check_open()
        self._last_flush = time.monotonic()
        if self._pending_rows or self._events:
            rows = np.concatenate(self._pending) if self._pending else empty_rows()
            self._pending, self._pending_rows = [], 0
            self._write_batch(rows)

    def sync(self) -> None:
        """Have the disk take what the kernel has, from any thread; may wait for the disk. An error ends the recording."""
        try:
            os.fdatasync(self._fd)
        except OSError as error:
            if self._open and error.errno not in _NO_DISK:
                self._sync_error = error

    def close(self, *, complete: bool = True) -> None:
        """Write what is pending, the end mark (if ``complete``) and sync to the disk. A second call does nothing.

        Raises:
            RecordingError: the end of the run did not reach the disk; the file is closed all the same.
        """
        if not self._open:
            return
        try:
            if self._failure is None:
                self.flush()
                if complete:
                    self._write_batch(empty_rows(), {TOTAL: b"%d" % self.rows_written})
                    self._staging.write(END_OF_STREAM)
                    self._write_staged()
                if stat.S_ISREG(os.fstat(self._fd).st_mode):
                    os.fsync(self._fd)
        except OSError as error:
            raise RecordingError(f"{self.path} may be incomplete: {error.strerror}") from error
        finally:
            self._open = False
            os.close(self._fd)

    def _check_open(self) -> None:
        if self._sync_error is not None and self._failure is None:
            # The kernel tells it once, and forgets it.
            cause = f"the disk failed ({self._sync_error.strerror})"
            lost = f"up to {self.rows_written} rows in {self.path} may not have reached it"
            self._failure = RecordingError(f"recording stopped: {cause}; {lost}")
        if self._failure is not None:
            raise self._failure
        if not self._open:
            raise RecordingError(f"{self.path} is closed")

    def _write_batch(self, rows: Rows, more: Mapping[bytes, bytes] | None = None) -> None:
        import pyarrow as pa

        notes = {FIRST_ROW: b"%d" % self.rows_written, **(more or {})}
        if self._events:
            notes[EVENTS] = json.dumps(self._events, allow_nan=False).encode()
        self._events = []
        columns = _columns(rows)
        notes[CHECK] = checksum(notes, columns)
        batch = pa.RecordBatch.from_arrays([pa.array(values) for values in columns], schema=self._schema)
        self._encoder.write_batch(batch, custom_metadata=notes)
        self._write_staged()
        self.rows_written += rows.size

    def _write_staged(self) -> None:
        """Write the staged bytes; on an error cut the file back to what was whole."""
        with self._staging.getbuffer() as staged:
            written = 0
            try:
                while written < staged.nbytes:
                    written += os.write(self._fd, staged[written:])
            except OSError as error:
                self._failure = self._cut_back(error)
                raise self._failure from error
            self._size += staged.nbytes
        self._staging.seek(0)
        self._staging.truncate()

    def _cut_back(self, error: OSError) -> RecordingError:
        cause = "the disk is full" if error.errno in _DISK_FULL else "the disk failed"
        kept = f"{self.rows_written} rows are kept in {self.path}"
        try:
            os.ftruncate(self._fd, self._size)
        except OSError:
            kept += " (its last batch is torn; readers leave it out)"
        return RecordingError(f"recording stopped: {cause} ({error.strerror}); {kept}")

    def __enter__(self) -> RunWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(complete=kind is None)


def arrow_schema(metadata: Mapping[str, Any]) -> Any:
    """``pyarrow.Schema`` of a run file: every field with ``unit`` and ``description``, the run's metadata beside them.

    Args:
        metadata: as `metadata.run_metadata` gives it; its ``linear`` decides the unit of forces.
    """
    import pyarrow as pa

    linear = bool(metadata["linear"])
    fields = [
        pa.field(
            column.name,
            pa.from_numpy_dtype(ROW[column.name]),
            nullable=False,
            metadata={"unit": column.unit_for(linear=linear), "description": column.description},
        )
        for column in COLUMNS
    ]
    schema = pa.schema(fields, metadata=encode_metadata(metadata))
    return schema.with_metadata({**schema.metadata, METADATA_CHECK: metadata_checksum(schema)})


def _columns(rows: Rows) -> list[NDArray[Any]]:
    """The columns, each contiguous, of one transposing copy of the rows as eight-byte words."""
    block = np.ascontiguousarray(rows).view(np.int64).reshape(rows.size, len(COLUMNS)).T.copy()
    return [words.view(ROW[column.name]) for words, column in zip(block, COLUMNS, strict=True)]
