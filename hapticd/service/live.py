"""The live stream: the rows that the recorder takes from the ring, as frames, for whoever looks at them now.

Nothing is done while nobody looks. While somebody does, the recorder's thread only hands over a reference to rows that
it has copied anyway; the API's event loop encodes them, once for all who look. To wake a thread for it cost more than the
encoding. Every buffer on the way is bounded and drops its oldest frame, so that a slow reader costs the daemon and the other
readers nothing; the row numbers in the frames (`hapticd.record.frames`) tell each reader what it missed.
"""

from __future__ import annotations

import asyncio
import contextlib
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
WAITING_FRAMES = 32
"""What a reader may fall behind before it loses its oldest frame: 2.5 s."""
MAX_READERS = 16
SIGN_OF_LIFE_S = 0.5
GATHER_S = 0.08
"""What comes within it travels in one frame: a frame costs every hop the same, however long it is, for what it costs is to
wake whoever sleeps there."""


class LiveStream:
    """Hands out frames to readers; the daemon's ``live``."""

    def __init__(self) -> None:
        self.watched = False
        """Whether anybody looks; the recorder's thread asks before it does anything."""
        self._readers: set[Reader] = set()
        self._inbox: deque[tuple[Rows, Context]] = deque(maxlen=INBOX_PORTIONS)
        self._encoding: asyncio.Task[None] | None = None
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
        reader = Reader(asyncio.get_running_loop())
        self._readers.add(reader)
        if self._encoding is None:
            self._inbox.clear()
            self.watched = True
            self._encoding = asyncio.create_task(self._encode())
        return reader

    def _leave(self, reader: Reader) -> None:
        self._readers.discard(reader)
        if not self._readers and self._encoding is not None:
            self.watched = False
            self._encoding.cancel()
            self._encoding = None

    def close(self) -> None:
        """End every reader's stream, and take no more; from any thread."""
        self._closed = True
        for reader in tuple(self._readers):
            reader.end()

    async def _encode(self) -> None:
        told_s = time.monotonic()
        while True:
            await asyncio.sleep(GATHER_S)
            now_s = time.monotonic()
            if not self._inbox and now_s - told_s > SIGN_OF_LIFE_S:
                self._inbox.append((empty_rows(), Context(0, 0, 1, 0.0, 0, time.time())))
            while self._inbox:
                frame = encode(*self._gather())
                for reader in self._readers:
                    reader.offer(frame)
                told_s = now_s

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
    """One who looks: a bounded queue in an event loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.ended = False
        self._loop = loop
        self._frames: deque[bytes] = deque(maxlen=WAITING_FRAMES)
        self._ready = asyncio.Event()

    def offer(self, frame: bytes) -> None:
        """Queue a frame, in place of the oldest when the queue is full."""
        self._frames.append(frame)
        self._ready.set()

    def end(self) -> None:
        """No more frames; from any thread."""
        self.ended = True
        with contextlib.suppress(RuntimeError):  # the loop is closed, and so is the connection
            self._loop.call_soon_threadsafe(self._ready.set)

    async def take(self) -> bytes:
        """All that waits, as soon as anything does."""
        await self._ready.wait()
        self._ready.clear()
        chunk = []
        while self._frames:
            frame = self._frames.popleft()
            chunk += [PREFIX.pack(len(frame)), frame]
        return b"".join(chunk)
