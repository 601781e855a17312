"""The live stream: the recorder's rows as frames, for all connected readers.

Without a reader it does nothing. With readers, the recorder's thread only passes a reference to rows that it has copied
anyway; the API's event loop encodes them, once for all readers. Waking up costs more than encoding: all readers sleep until
the same time, and the first to wake encodes the frame. The newest frames are kept for slow readers; the row numbers
(`hapticd.record.frames`) show each reader what it missed, and no reader waits for another.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import replace
from itertools import islice

from hapticd.record.frames import PREFIX, Context, encode
from hapticd.record.schema import Rows, empty_rows, joined
from hapticd.service.refusals import Refused

INBOX_PORTIONS = 256
GATHER_ROWS = 4096
WAITING_FRAMES = 32
"""Frames that are kept: a reader that is more than 2.5 s behind loses the oldest."""
MAX_READERS = 16
SIGN_OF_LIFE_S = 0.5
GATHER_S = 0.08
"""Rows of this time form one frame: the cost of a frame hardly depends on its length, because it is that of waking the
receivers."""


class LiveStream:
    """Gives frames to readers; the daemon's ``live``."""

    def __init__(self) -> None:
        self.watched = False
        """Whether there is a reader; checked by the recorder's thread first."""
        self._readers = 0
        self._inbox: deque[tuple[Rows, Context]] = deque(maxlen=INBOX_PORTIONS)
        self._frames: deque[bytes] = deque(maxlen=WAITING_FRAMES)
        self._made = 0
        """Number of frames since the daemon started."""
        self._sent_s = 0.0
        self._due_s = 0.0
        self._closed = False

    def put(self, rows: Rows, context: Context) -> None:
        """Add rows, which must not be changed afterwards; called by the recorder's thread, and never waits."""
        if len(rows):
            self._inbox.append((rows, context))

    def refuse_more(self) -> None:
        """Refuse another reader if there are too many.

        Raises:
            Refused: there are 16 readers, or the daemon is ending.
        """
        if self._closed or self._readers >= MAX_READERS:
            why = "the daemon ends" if self._closed else f"{MAX_READERS} readers look at the stream already"
            raise Refused("stream", why)

    async def chunks(self) -> AsyncIterator[bytes]:
        """The frames from now on, each with its length before it; at least an empty one every half second.

        A reader counts from its first requested chunk to the end of its iteration.
        """
        if not self._readers:
            self._inbox.clear()
            self._sent_s = time.monotonic()
            self._due_s = self._sent_s + GATHER_S
        self._readers += 1
        self.watched = True
        seen = self._made
        try:
            while not self._closed:
                await asyncio.sleep(self._due_s - time.monotonic())
                self._encode()
                if new := min(self._made - seen, len(self._frames)):
                    seen = self._made
                    yield b"".join(islice(self._frames, len(self._frames) - new, None))
        finally:
            self._readers -= 1
            if not self._readers:
                self.watched = False
                self._frames.clear()

    def close(self) -> None:
        """End every stream within the time of a frame, and accept no new readers; from any thread."""
        self._closed = True

    def _encode(self) -> None:
        """Encode the waiting rows as frames, if it is time."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + GATHER_S
        if not self._inbox and now_s - self._sent_s > SIGN_OF_LIFE_S:
            self._inbox.append((empty_rows(), Context(0, 0, 1, 0.0, 0, time.time())))
        while self._inbox:
            frame = encode(*self._gather())
            self._frames.append(PREFIX.pack(len(frame)) + frame)
            self._made += 1
            self._sent_s = now_s

    def _gather(self) -> tuple[Rows, Context]:
        """The oldest waiting rows, and all that follow without a gap and with the same settings."""
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
        return joined(*parts), context
