"""All that leaves the daemon by terminal, standard error, log and journal: one thread writes it, and nobody waits for that.

A terminal that nobody reads (Ctrl-S, a dead ssh), a full pipe and a journal that hangs block this thread alone. What then
finds no room in the queue is dropped and counted, and one line says how much it was as soon as something can be written
again.
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
"""Lines that may wait; in an hour without a fault the daemon says less."""
LONGEST = 1 << 14
"""Characters of one of them: a request may put 64 KiB into a line of the log."""
END_S = 0.5
"""What is left at the end has this long."""
_FEW = 2
_POLL_S = 0.005


class Sink:
    """The thread ``hapticd-sink`` and what it still has to write. Made before anything that could have to be stopped.

    Raises:
        RuntimeError: the system gives no thread.
    """

    def __init__(self) -> None:
        self._thread = Background("hapticd-sink")
        # Reentrant: a finalizer may say something at any allocation.
        self._counting = threading.RLock()
        self._dropped = self._told = 0
        self._failed = False
        self._before: TextIO | None = None
        self._stderr = SinkStream(self, sys.stderr)

    @property
    def stream(self) -> TextIO:
        """Standard error by way of this sink."""
        return cast(TextIO, self._stderr)

    @property
    def dropped(self) -> int:
        """Lines that were lost: the queue was full, or writing failed."""
        return self._dropped

    @property
    def behind(self) -> bool:
        """Whether what was said before is still to be written, or cannot be: no time for what is of the moment only."""
        return self._failed or self._thread.waiting() > _FEW

    def alive(self) -> bool:
        """Whether the thread still runs."""
        return self._thread.alive()

    def put(self, write: Callable[[], object]) -> None:
        """Have something written after what waits already; never blocks, never raises.

        Args:
            write: writes it, for as long as that may take; raises OSError where it cannot.
        """
        if self._thread.waiting() < ROOM:
            self._thread.ask(partial(self._write, write))
        else:
            self._lose()

    def take_stderr(self) -> None:
        """Put `stream` in the place of ``sys.stderr``: warnings, tracebacks of threads and ``print`` go here, too."""
        if self._before is None:
            self._before, sys.stderr = sys.stderr, self.stream

    def end(self, timeout_s: float = END_S) -> bool:
        """Give what waits some time; whether all of it is written. Safe to call twice.

        Where it is, ``sys.stderr`` is again what it was. Else it stays here, and who still says something does not hang.
        """
        deadline = time.monotonic() + timeout_s
        while self._thread.waiting() and time.monotonic() < deadline:
            time.sleep(_POLL_S)
        ended = self._thread.end(max(0.0, deadline - time.monotonic()))
        if ended and self._before is not None and sys.stderr is self._stderr:
            sys.stderr, self._before = self._before, None
        return ended

    def write_now(self, text: str) -> None:
        """Write to standard error, however long that takes; for what `put` was given.

        Raises:
            OSError, ValueError: it cannot be written.
        """
        self._stderr.write_now(text)

    def _write(self, write: Callable[[], object]) -> None:
        try:
            write()
        except (OSError, ValueError):  # a terminal or a reader that is gone; a closed file
            self._failed = True
            self._lose()
            return
        self._failed = False
        if self._dropped != self._told and self._thread.waiting() < ROOM // 2:
            with self._counting:
                lost, self._told = self._dropped - self._told, self._dropped
            log.warning("%d lines that were said before this one are lost: nobody read them in time", lost)

    def _lose(self) -> None:
        with self._counting:
            self._dropped += 1


class SinkStream(io.TextIOBase):
    """A text stream whose ``write`` only queues.

    Args:
        sink: what writes it.
        below: the stream in whose place this one is; None where there is none, as after ``2>&-``: all is thrown away, for
            the number of its descriptor may be a device's by now.
    """

    def __init__(self, sink: Sink, below: TextIO | None) -> None:
        super().__init__()
        self._sink, self._below = sink, below
        self._descriptor: int | None = None
        with contextlib.suppress(OSError, ValueError, AttributeError):
            self._descriptor = below.fileno() if below is not None else None

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Of the stream below."""
        return getattr(self._below, "encoding", None) or "utf-8"

    def write(self, text: str, /) -> int:
        """Queue a text, of which at most `LONGEST` characters are written."""
        if text and self._below is not None:
            self._sink.put(partial(self.write_now, cut(text)))
        return len(text)

    def write_now(self, text: str) -> None:
        """Write a text, however long that takes; for the sink's thread alone.

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
        """Nothing: waiting is what this is to prevent."""

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
    """At most `LONGEST` characters of a text, and how many it had."""
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} … ({len(text)} characters)\n"


def write_all(descriptor: int, data: bytes) -> None:
    """Write all of it, however long that takes, also where somebody has made the descriptor a non-blocking one.

    Past Python's own buffer and its lock: a thread that hangs here must not keep the process from ending.
    """
    left = memoryview(data)
    while left:
        try:
            left = left[os.write(descriptor, left) :]
        except BlockingIOError:
            ready = select.poll()
            ready.register(descriptor, select.POLLOUT)
            ready.poll()
