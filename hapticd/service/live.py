"""The live stream: the rows that the recorder takes from the ring, as frames, for whoever looks at them now.

Nothing is done while nobody looks. While somebody does, the recorder's thread only hands over a reference to rows that
it has copied anyway; a thread of its own encodes them, once for all who look. Every buffer on the way is bounded and
drops its oldest frame, so that a slow reader costs the daemon and the other readers nothing; the row numbers in the
frames (`hapticd.record.frames`) tell each reader what it missed.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import replace

import numpy as np

from hapticd.record.frames import PREFIX, Context, encode
from hapticd.record.schema import Rows, empty_rows
from hapticd.service.refusals import Refused

INBOX_PORTIONS = 256
GATHER_ROWS = 4096
WAITING_FRAMES = 64
"""At 25 frames a second, what a reader may fall behind before it loses its oldest frame: 2.5 s."""
MAX_READERS = 16
SIGN_OF_LIFE_S = 0.5
GATHER_S = 0.04
"""What comes within it travels in one frame: a frame costs every hop the same, however long it is."""


class LiveStream:
    """Hands out frames to readers; the daemon's ``live``."""

    def __init__(self) -> None:
        self.watched = False
        """Whether anybody looks; the recorder's thread asks before it does anything."""
        self._readers: set[Reader] = set()
        self._lock = threading.Lock()
        self._inbox: deque[tuple[Rows, Context]] = deque(maxlen=INBOX_PORTIONS)
        self._thread: threading.Thread | None = None
        self._closed = False

    def put(self, rows: Rows, context: Context) -> None:
        """Take rows, which nobody may change afterwards; called by the recorder's thread, and never waits."""
        if len(rows):
            self._inbox.append((rows, context))

    def refuse_more(self) -> None:
        """Refuse another reader where there are enough.

        Raises:
            Refused: 16 look already, or the daemon ends.
        """
        if self._closed or len(self._readers) >= MAX_READERS:
            why = "the daemon ends" if self._closed else f"{MAX_READERS} readers look at the stream already"
            raise Refused("stream", why)

    async def chunks(self) -> AsyncIterator[bytes]:
        """The frames from now on, each with its length before it; an empty one at least every half second.

        A reader exists from the first chunk that is asked for to the end of the iteration, however that comes about.
        """
        reader = self._subscribe()
        try:
            while not reader.ended:
                yield await reader.take()
        finally:
            self._leave(reader)

    def _subscribe(self) -> Reader:
        with self._lock:
            reader = Reader(asyncio.get_running_loop())
            self._readers.add(reader)
            if self._thread is None:
                self._inbox.clear()
                self.watched = True
                self._thread = threading.Thread(target=self._encode, name="hapticd-stream", daemon=True)
                self._thread.start()
            return reader

    def _leave(self, reader: Reader) -> None:
        with self._lock:
            self._readers.discard(reader)
            if self._readers:
                return
            self.watched = False
            self._thread = None  # it sees that by itself, 40 ms later

    def close(self) -> None:
        """End every reader's stream, and take no more."""
        with self._lock:
            self._closed = True
            readers = list(self._readers)
        for reader in readers:
            reader.end()

    def _encode(self) -> None:
        me, silent_s = threading.current_thread(), 0.0
        while self._thread is me:
            time.sleep(GATHER_S)
            silent_s += GATHER_S
            while self._inbox and self._thread is me:
                self._offer(encode(*self._gather()))
                silent_s = 0.0
            if silent_s > SIGN_OF_LIFE_S:
                self._offer(encode(empty_rows(), Context(0, 0, 1, 0.0, 0, time.time())))
                silent_s = 0.0

    def _offer(self, frame: bytes) -> None:
        with self._lock:
            readers = list(self._readers)
        for reader in readers:
            reader.offer(frame)

    def _gather(self) -> tuple[Rows, Context]:
        """The oldest portion that waits, and those behind it that go on where it ends, under the same settings."""
        rows, context = self._inbox.popleft()
        parts, count = [rows], len(rows)
        while self._inbox and count < GATHER_ROWS:
            rows, following = self._inbox[0]
            if following != replace(context, first_row=context.first_row + count, unix_s=following.unix_s):
                break
            self._inbox.popleft()
            parts.append(rows)
            count += len(rows)
            context = replace(context, unix_s=following.unix_s)
        return (np.concatenate(parts) if len(parts) > 1 else parts[0]), context


class Reader:
    """One who looks: a bounded queue between the encoding thread and an event loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.ended = False
        self._loop = loop
        self._frames: deque[bytes] = deque(maxlen=WAITING_FRAMES)
        self._ready = asyncio.Event()

    def offer(self, frame: bytes) -> None:
        """Queue a frame, in place of the oldest when the queue is full; from any thread."""
        self._frames.append(frame)
        self._notify()

    def end(self) -> None:
        """No more frames; from any thread."""
        self.ended = True
        self._notify()

    def _notify(self) -> None:
        try:
            self._loop.call_soon_threadsafe(self._ready.set)
        except RuntimeError:  # the loop is closed, and so is the connection
            self.ended = True

    async def take(self) -> bytes:
        """All that waits, as soon as anything does."""
        await self._ready.wait()
        self._ready.clear()
        chunk = []
        while self._frames:
            frame = self._frames.popleft()
            chunk += [PREFIX.pack(len(frame)), frame]
        return b"".join(chunk)
