from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import numpy as np

from hapticd.record.schema import FLAG_DROPPED, Rows, empty_rows

CONFIG = {"servo": {"rate_hz": 1000.0}, "plant": {"inertia": 6.28e-6}, "encoder": {"counts_per_rev": 8192}}


def make_rows(count: int, first: int = 0, rate_hz: float = 1000.0) -> Rows:
    rows = empty_rows(count)
    rows["tick"] = np.arange(first, first + count)
    rows["time_s"] = rows["tick"] / rate_hz
    rows["encoder_counts"] = -3 * rows["tick"]
    rows["ticks"] = rows["encoder_counts"] // 217
    rows["current_command_A"] = np.sin(rows["tick"] / 7.0)
    rows["current_measured_A"] = np.nan
    rows["force_command"] = 0.0292 * rows["current_command_A"]
    rows["wake_late_ns"] = 1000 + rows["tick"] % 100
    rows["exec_ns"] = 700
    rows["flags"] = 1
    return rows


class Ring:
    """Stands in for the servo's ring: rows pushed from a test, drained by the recorder."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.chunks: list[Rows] = []
        self.made = 0
        self.lost = 0
        self.rate_hz = 1000.0
        self.newest = empty_rows()
        self.full = False
        self.inside = 0
        self.most_inside = 0
        self.broken: Exception | None = None

    def push(self, count: int, at: float | None = None) -> None:
        rows = make_rows(count, self.made, self.rate_hz)
        if at is not None:
            rows["time_s"] = at
        with self.lock:
            if self.full:
                rows["flags"][0] |= FLAG_DROPPED
                self.full = False
            self.chunks.append(rows)
            self.newest = np.concatenate([self.newest, rows])[-20_000:]
            self.made += count

    def lose(self, count: int) -> None:
        """Rows that find no room."""
        with self.lock:
            self.made += count
            self.lost += count
            self.full = True

    def history(self, seconds: float) -> Rows:
        with self.lock:
            return self.newest[self.newest["time_s"] > (self.made - 1) / self.rate_hz - seconds]

    def drain(self) -> Iterator[Rows]:
        with self.lock:
            self.inside += 1
            self.most_inside = max(self.most_inside, self.inside)
        if self.broken is not None:
            raise self.broken
        with self.lock:
            rows = np.concatenate([empty_rows(), *self.chunks])
            self.chunks = []
            self.inside -= 1
        for first in range(0, max(rows.size, 1), 256):
            yield rows[first : first + 256]


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.005)
