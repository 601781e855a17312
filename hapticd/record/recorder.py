"""The recorder: one thread that empties the servo's ring into the run file.

The servo thread never waits for it: all it shares with the servo is the ring behind ``drain``. Every use of the ring
and the writer is under one lock, so the ring keeps a single consumer also when a request starts or stops a recording.
`status` and `dump_past` take no lock: they answer while the disk hangs. What comes meanwhile waits in the ring; rows that
find no room there are lost, and the run says which. A second thread has the disk take the run every second.

Before rows are written the file is looked at: where somebody has deleted, moved or changed it the recording goes on in a
new one, in the same folder, which is made again; where it cannot, it has failed, and says why.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hapticd.record.errors import RecordingError
from hapticd.record.files import open_new_run
from hapticd.record.flight import PAST_S
from hapticd.record.metadata import to_plain, utc_now
from hapticd.record.schema import FLAG_DROPPED, Rows
from hapticd.record.writer import RunWriter

POLL_S = 0.02
SYNC_S = 1.0
_STALL_S = 1.0
LOCK_TIMEOUT_S = 5.0
_DUMP_ROWS = 4096
_NOTES_SHOWN = 16
MOST_FILES = 100
"""Of one recording: whatever takes them away would go on."""

log = logging.getLogger(__name__)


class Recorder:
    """Records what the servo loop leaves in its ring; starts its thread at once.

    Args:
        drain: takes the rows that wait in the ring when it is called, at most the ring's size, in batches, of which there
            is at least one, be it empty; called by one thread at a time.
        dropped: rows the ring had to drop since the servo loop began.
        history: copies the rows of the last so many seconds, whether drained or not; called from any thread.
        metadata: what describes a run begun now; see `metadata.run_metadata`.
        directory: where runs without a path of their own go.
    """

    def __init__(
        self,
        drain: Callable[[], Iterable[Rows]],
        dropped: Callable[[], int],
        history: Callable[[float], Rows],
        metadata: Callable[[], Mapping[str, Any]],
        directory: str | Path,
    ) -> None:
        self.directory = Path(directory)
        self._drain, self._dropped, self._history, self._metadata = drain, dropped, history, metadata
        self._writer: RunWriter | None = None
        self._path: Path | None = None
        self._state = "off"
        self._error: str | None = None
        self._label, self._more = "", dict[str, Any]()
        self._files = 0
        self._continued: str | None = None
        self._rows = 0
        self._rows_before = 0
        self._dropped_before = 0
        self._dropped_here = 0
        self._last_tick: int | None = None
        self._notes: tuple[dict[str, Any], ...] = ()
        self._writing_since: float | None = None
        self._lock = threading.Lock()
        self._ending = threading.Event()
        # Loaded now, so that the first fault does not wait for it.
        importlib.import_module("pyarrow")
        self._thread = threading.Thread(target=self._run, name="hapticd-recorder", daemon=True)
        self._thread.start()
        self._syncing = threading.Thread(target=self._sync, name="hapticd-sync", daemon=True)
        self._syncing.start()

    def start(self, path: str | Path | None = None, label: str = "", more: Mapping[str, Any] | None = None) -> Path:
        """Begin a recording; its first row is the first that the ring gives from now on.

        Args:
            path: the file to create, which must not exist, in a folder that does; None names one in the run directory.
            label: goes into the metadata and into a name made here.
            more: further metadata.

        Raises:
            RecordingError: a recording is on, or the file or its folder cannot be made.
        """
        self._more = dict(more or {})
        described = self._described("run", label)
        with self._exclusive():
            if self._writer is not None:
                raise RecordingError(f"already recording to {self._writer.path}; stop that first")
            writer = RunWriter(path, described) if path else open_new_run(self.directory, "run", label, described)
            self.pull()  # what came while the file was made does not belong to this recording
            self._dropped_before, self._dropped_here = self._dropped(), 0
            self._rows_before += self._rows
            self._last_tick = None
            self._label, self._files, self._continued, self._notes = label, 1, None, ()
            self._error, self._rows, self._path, self._state = None, 0, writer.path, "recording"
            self._writer = writer
            return writer.path

    def stop(self) -> Path | None:
        """End the recording; every row made before this call is in the file when it returns.

        Returns:
            The file, also that of a recording which failed since the last start (`status` says why); else None.

        Raises:
            RecordingError: the disk has not answered for seconds.
        """
        with self._exclusive():
            if self._writer is None:
                return self._path if self._state == "failed" else None
            self.pull()
            self._close()
            return self._path

    def annotate(self, event: Mapping[str, Any]) -> None:
        """Note an event (say, a changed setting) in the recording, if one is on."""
        with self._exclusive():
            self.pull()
            if self._writer is not None:
                self._writer.annotate({"utc": utc_now(), **event})

    def note(self, event: Mapping[str, Any]) -> Path | None:
        """Keep a note or a marker with the recording, and the newest few for `status`; the file, None where none is on."""
        with self._exclusive():
            self.pull()
            if self._writer is None:
                return None
            noted = to_plain({"utc": utc_now(), **event})
            self._writer.annotate(noted)
            self._notes = (*self._notes, noted)[-_NOTES_SHOWN:]
            return self._writer.path

    def dump_past(self, label: str) -> Path:
        """Write the last 10 s before now to ``fault-<UTC time>-<label>.arrow``, in the calling thread.

        Raises:
            RecordingError: the file or its folder cannot be made, or the disk is full.
        """
        rows = self._history(PAST_S)
        described = self._described("fault", label)
        with open_new_run(self.directory, "fault", label, described) as writer:
            for start in range(0, rows.size, _DUMP_ROWS):
                writer.write(rows[start : start + _DUMP_ROWS])
                writer.flush()
        return writer.path

    def status(self) -> dict[str, Any]:
        """The recorder now, without waiting for it.

        Returns:
            ``state`` (``off``, ``recording``, ``failed``), ``path`` (None when off), ``rows`` (in that file, or the last),
            ``rows_total`` and ``dropped_total`` (since the servo loop began), ``dropped`` (of this or the last recording),
            ``stalled_s`` (how long the disk has not answered, s), ``error`` (None or text), ``continued`` (what became of
            the file that this recording, or the last, was in before, None or text), ``notes`` (the newest of this
            or the last recording), ``bytes_per_row`` (as written, None before the first).
        """
        since, writer = self._writing_since, self._writer
        ended = not (self._thread.is_alive() or self._ending.is_set())
        error = "the recorder's thread has ended: no row is written any more; restart the daemon" if ended else None
        return {
            "state": "failed" if ended else self._state,
            "path": None if self._state == "off" else str(self._path),
            "rows": self._rows,
            "rows_total": self._rows_before + self._rows,
            "dropped": self._dropped_here,
            "dropped_total": self._dropped(),
            "stalled_s": 0.0 if since is None else time.monotonic() - since,
            "error": error or self._error,
            "continued": self._continued,
            "notes": list(self._notes),
            "bytes_per_row": writer.size / writer.rows_written if writer and writer.rows_written else None,
        }

    def alive(self) -> dict[str, bool]:
        """Names of its threads, and whether each still runs."""
        return {thread.name: thread.is_alive() for thread in (self._thread, self._syncing)}

    def shutdown(self) -> Path | None:
        """Stop the recording, if any, and end the thread; the recorder cannot be used afterwards.

        Returns:
            As `stop`.
        """
        try:
            return self.stop()
        finally:
            self._ending.set()
            self._thread.join(LOCK_TIMEOUT_S)
            self._syncing.join(LOCK_TIMEOUT_S)

    def _described(self, kind: str, label: str) -> dict[str, Any]:
        return {**self._metadata(), **(self._more if kind == "run" else {}), "kind": kind, "label": label}

    @contextlib.contextmanager
    def _exclusive(self) -> Iterator[None]:
        if not self._lock.acquire(timeout=LOCK_TIMEOUT_S):
            raise RecordingError(f"the disk has not answered for {LOCK_TIMEOUT_S:.0f} s while writing {self._path}")
        try:
            yield
        finally:
            self._lock.release()

    def _run(self) -> None:
        while not self._ending.wait(POLL_S):
            with self._lock:
                self.pull()

    def pull(self) -> None:
        """Take what the ring holds, once: the time is bounded by the ring's size, however fast the producer is."""
        try:
            for rows in self._drain():
                self._record(rows)
        except Exception as error:
            # Whatever broke, the thread lives on: it serves the next recording.
            self._fail(f"recording stopped: {type(error).__name__}: {error}")

    def _record(self, rows: Rows) -> None:
        if self._writer is None:
            return
        self._dropped_here = self._dropped() - self._dropped_before
        self._writing_since = began = time.monotonic()
        try:
            if (what := self._writer.lost()) is not None:
                self._go_on(what)
            written = 0
            for first in np.flatnonzero(rows["flags"] & FLAG_DROPPED).tolist():
                self._writer.write(rows[written:first])
                self._note_lost(rows, first)
                written = first
            self._writer.write(rows[written:])
            self._rows = self._writer.rows
            if rows.size:
                self._last_tick = int(rows["tick"][-1])
            if (stalled := time.monotonic() - began) > _STALL_S:
                self._writer.annotate({"event": "stalled", "utc": utc_now(), "seconds": stalled})
                log.warning("the disk did not answer for %.1f s; rows waited in memory", stalled)
        except RecordingError as error:
            self._rows = self._writer.rows_written
            self._fail(str(error))
        finally:
            self._writing_since = None

    def _go_on(self, what: str) -> None:
        """Go on in a new file; what was accepted and is not in the old one comes first.

        Raises:
            RecordingError: there can be none.
        """
        old = self._writer
        assert old is not None
        lost = f"{old.path} {what}; {old.rows_written} rows were in it"
        if self._files >= MOST_FILES:
            raise RecordingError(f"recording stopped: {lost}; it was the file number {self._files} of this recording")
        try:
            new = open_new_run(old.path.parent, "run", self._label, self._described("run", self._label))
        except RecordingError as error:
            raise RecordingError(f"recording stopped: {lost}; {error}") from error
        self._rows_before += old.rows_written
        self._files += 1
        self._writer, self._path, self._rows = new, new.path, 0
        self._continued = f"{lost}; the recording goes on in {new.path}"
        log.error("%s", self._continued)
        rows, events = old.abandon()
        before = {"file": str(old.path), "what": what, "rows": old.rows_written}
        for event in ({"event": "continued", "utc": utc_now(), **before}, *events):
            new.annotate(event)
        new.write(rows)

    def _note_lost(self, rows: Rows, first: int) -> None:
        """Say between which ticks rows found no room in the ring."""
        assert self._writer is not None
        before = int(rows["tick"][first - 1]) if first else self._last_tick
        if before is not None:
            tick = int(rows["tick"][first])
            lost = {"rows": tick - before - 1, "after_tick": before, "before_tick": tick}
            self._writer.annotate({"event": "dropped", "utc": utc_now(), **lost})
            log.error("%d rows were lost between the ticks %d and %d", tick - before - 1, before, tick)

    def _sync(self) -> None:
        """Have the disk take what was written: a power cut then costs little more than a second."""
        while not self._ending.wait(SYNC_S):
            writer = self._writer
            if writer is not None:
                writer.sync()

    def _close(self) -> None:
        """End the file with its counts; what fails on the way is in `status`, and the file is closed all the same."""
        if self._writer is None:
            return
        try:
            self._writer.annotate({"event": "end", "utc": utc_now(), "rows": self._rows, "dropped": self._dropped_here})
            self._writer.close()
        except RecordingError as error:
            self._rows = self._writer.rows_written
            self._fail(str(error))
        else:
            self._writer, self._state = None, "off"

    def _fail(self, cause: str) -> None:
        """Say why once, and close the file at its last whole batch."""
        if cause != self._error:
            log.error("%s", cause)
        self._error = cause
        writer, self._writer = self._writer, None
        if writer is not None:
            self._state = "failed"
            with contextlib.suppress(RecordingError):
                writer.close(complete=False)
