"""The last ten seconds of rows in bounded memory, kept whether or not a recording is on, for when a fault asks."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from hapticd.record.schema import Rows, check_rows, empty_rows

HISTORY_S = 10.0
_SLACK_ROWS = 1024


class History:
    """Rows of the last ``seconds`` of servo time, oldest first. Not thread-safe.

    Bounded twice: by the rows' own ``time_s``, which stays right when the rate changes, and by the number of rows that
    the highest rate seen can make in that time, which holds whatever the time column says. Rows whose time goes back
    (the servo loop was restarted) begin a new history, so that one dump never mixes two time bases.
    """

    def __init__(self, seconds: float = HISTORY_S) -> None:
        self.seconds = seconds
        self.rows = 0
        self._chunks: deque[Rows] = deque()
        self._highest_rate = 0.0

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(chunk.nbytes for chunk in self._chunks)

    def add(self, rows: Rows, rate_hz: float) -> None:
        """Append a copy of the rows and forget what is too old.

        Args:
            rows: shape (n,), in time order.
            rate_hz: the servo rate now; bounds the memory.
        """
        check_rows(rows)
        if not rows.size:
            return
        if self._chunks and rows["time_s"][0] < self._chunks[-1]["time_s"][-1]:
            self._chunks.clear()
            self.rows = 0
        self._highest_rate = max(self._highest_rate, rate_hz)
        limit = math.ceil(self.seconds * self._highest_rate) + _SLACK_ROWS
        rows = rows[-limit:]
        # Small chunks, so that forgetting a whole one for its oldest row takes nothing that is still wanted.
        for start in range(0, rows.size, _SLACK_ROWS):
            self._chunks.append(rows[start : start + _SLACK_ROWS].copy())
        self.rows += rows.size
        oldest_time = rows["time_s"][-1] - self.seconds
        while len(self._chunks) > 1 and (self.rows > limit or self._chunks[0]["time_s"][-1] <= oldest_time):
            self.rows -= self._chunks.popleft().size

    def snapshot(self) -> Rows:
        """Copy of the rows of the last ``seconds``, shape (n,), oldest first."""
        if not self._chunks:
            return empty_rows()
        rows: Rows = np.concatenate(self._chunks)
        first = np.flatnonzero(rows["time_s"] > rows["time_s"][-1] - self.seconds)[:1]
        recent: Rows = rows[int(first[0]) :] if first.size else rows
        return recent
