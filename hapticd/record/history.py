"""The last ten seconds of rows in bounded memory, kept whether or not a recording is on, for when a fault asks.

They lie in one block, which is as large at the start as ever: rows that came and went one by one would leave holes in the
memory of a process that runs for weeks.
"""

from __future__ import annotations

import math
from bisect import bisect_right

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
        self._block = empty_rows()
        self._oldest = 0

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self._block.nbytes

    def add(self, rows: Rows, rate_hz: float) -> None:
        """Copy the rows and forget what is too old.

        Args:
            rows: shape (n,), in time order.
            rate_hz: the servo rate now; bounds the memory.
        """
        check_rows(rows)
        if not rows.size:
            return
        if self.rows and rows["time_s"][0] < self._time_s(self.rows - 1):
            self.rows = 0
        size = math.ceil(self.seconds * rate_hz) + _SLACK_ROWS
        if size > self._block.size:
            self._enlarge(size)
        rows = rows[-self._block.size :]
        self._drop(self.rows + rows.size - self._block.size)
        begin = (self._oldest + self.rows) % self._block.size
        until_end = self._block.size - begin
        self._block[begin : begin + rows.size] = rows[:until_end]
        self._block[: max(rows.size - until_end, 0)] = rows[until_end:]
        self.rows += rows.size
        self._drop(bisect_right(range(self.rows), rows["time_s"][-1] - self.seconds, key=self._time_s))

    def snapshot(self) -> Rows:
        """Copy of the rows of the last ``seconds``, shape (n,), oldest first."""
        end = self._oldest + self.rows
        rows: Rows = np.concatenate([self._block[self._oldest : end], self._block[: max(end - self._block.size, 0)]])
        return rows

    def _time_s(self, index: int) -> float:
        return float(self._block["time_s"][(self._oldest + index) % self._block.size])

    def _drop(self, rows: int) -> None:
        """Forget that many of the oldest rows; none when negative."""
        if rows > 0:
            self._oldest = (self._oldest + rows) % self._block.size
            self.rows -= rows

    def _enlarge(self, size: int) -> None:
        kept = self.snapshot()
        self._block, self._oldest = empty_rows(size), 0
        self._block[: kept.size] = kept
