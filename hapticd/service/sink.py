"""One thread writes all output of the daemon to terminal, standard error, log and journal; no other thread waits for it.

A blocked terminal (Ctrl-S, a dead ssh), a full pipe or a hanging journal block only this thread. Lines that do not fit into
the queue are dropped and counted; one line reports their number as soon as writing works again.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import select
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import TextIO, cast

from hapticd.service.background import Background

log = logging.getLogger(__name__)

ROOM = 1000
"""Capacity of the queue [lines]; in an hour without a fault the daemon writes fewer."""
LONGEST = 1 << 14
"""Longest line [characters]: a request may put 64 KiB into a line of the log."""
END_S = 0.5
"""Time for the remaining lines at the end [s]."""
_FEW = 2
_POLL_S = 0.005


class Sink:
    """The thread ``hapticd-sink`` and its queue. Created before everything else.

    Raises:
        RuntimeError: a thread cannot be created.
    """

    def __init__(self) -> None:
        self._thread = Background("hapticd-sink")
        # Reentrant: a finalizer may write at any allocation.
        self._counting = threading.RLock()
        self._dropped = self._told = 0
        self._failed = False
        self._before: TextIO | None = None
        self._stderr = SinkStream(self, sys.stderr)

    @property
    def stream(self) -> TextIO:
        """Standard error through this sink."""
        return cast(TextIO, self._stderr)

    @property
    def dropped(self) -> int:
        """Number of lost lines: the queue was full, or writing failed."""
        return self._dropped

    @property
    def behind(self) -> bool:
        """Whether lines are still waiting, or cannot be written: then a live line is left out."""
        return self._failed or self._thread.waiting() > _FEW

    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.alive()

    def put(self, write: Callable[[], object]) -> None:
        """Queue an output; never blocks, never raises.

        Args:
            write: writes it, and may block; raises OSError on a failure.
        """
        if self._thread.waiting() < ROOM:
            self._thread.ask(partial(self._write, write))
        else:
            self._lose()

    def take_stderr(self) -> None:
        """Replace ``sys.stderr`` by `stream`, also for warnings, tracebacks of threads and ``print``."""
        if self._before is None:
            self._before, sys.stderr = sys.stderr, self.stream

    def end(self, timeout_s: float = END_S) -> bool:
        """Give the waiting lines some time; returns whether all are written. Safe to call twice.

        If so, ``sys.stderr`` is restored. Otherwise it stays replaced, so that further output does not hang.
        """
        deadline = time.monotonic() + timeout_s
        while self._thread.waiting() and time.monotonic() < deadline:
            time.sleep(_POLL_S)
        ended = self._thread.end(max(0.0, deadline - time.monotonic()))
        if ended and self._before is not None and sys.stderr is self._stderr:
            sys.stderr, self._before = self._before, None
        return ended

    def write_now(self, text: str) -> None:
        """Write to standard error, and block if necessary; for functions given to `put`.

        Raises:
            OSError, ValueError: it cannot be written.
        """
        self._stderr.write_now(text)

    def _write(self, write: Callable[[], object]) -> None:
        try:
            write()
        except (OSError, ValueError):  # a closed terminal, pipe or file
            self._failed = True
            self._lose()
            return
        self._failed = False
        if self._dropped != self._told and self._thread.waiting() < ROOM // 2:
            with self._counting:
                lost, self._told = self._dropped - self._told, self._dropped
            log.warning("%d lines before this one are lost: they were not read in time", lost)

    def _lose(self) -> None:
        with self._counting:
            self._dropped += 1


class SinkStream(io.TextIOBase):
    """A text stream whose ``write`` only queues.

    Args:
        sink: writes it.
        below: the replaced stream; None if there is none, as after ``2>&-``: then all output is discarded, because the
            number of its descriptor may now belong to a device.
    """

    def __init__(self, sink: Sink, below: TextIO | None) -> None:
        super().__init__()
        self._sink, self._below = sink, below
        self._descriptor: int | None = None
        with contextlib.suppress(OSError, ValueError, AttributeError):
            self._descriptor = below.fileno() if below is not None else None

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the stream below."""
        return getattr(self._below, "encoding", None) or "utf-8"

    def write(self, text: str, /) -> int:
        """Queue a text, cut to `LONGEST` characters."""
        if text and self._below is not None:
            self._sink.put(partial(self.write_now, cut(text)))
        return len(text)

    def write_now(self, text: str) -> None:
        """Write a text, and block if necessary; for the sink's thread only.

        Raises:
            OSError, ValueError: it cannot be written.
        """
        if self._descriptor is not None:
            write_all(self._descriptor, text.encode(self.encoding, "backslashreplace"))
        elif self._below is not None:
            self._below.write(text)
            self._below.flush()

    def writable(self) -> bool:
        """True."""
        return True

    def flush(self) -> None:
        """Do nothing, because it must not wait."""

    def isatty(self) -> bool:
        """Whether the stream below is a terminal."""
        return self._below is not None and self._below.isatty()

    def fileno(self) -> int:
        """The descriptor below.

        Raises:
            OSError: there is none.
        """
        if self._descriptor is None:
            raise io.UnsupportedOperation("fileno")
        return self._descriptor


def cut(text: str) -> str:
    """A text cut to `LONGEST` characters, with its original length."""
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} … ({len(text)} characters)\n"


def write_all(descriptor: int, data: bytes) -> None:
    """Write all data, and block if necessary, also on a non-blocking descriptor.

    It bypasses Python's buffer and its lock: a thread that hangs here must not prevent the end of the process.
    """
    left = memoryview(data)
    while left:
        try:
            left = left[os.write(descriptor, left) :]
        except BlockingIOError:
            ready = select.poll()
            ready.register(descriptor, select.POLLOUT)
            ready.poll()
