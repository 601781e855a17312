"""How late threads of ordinary priority wake, on every processor, as a process of its own sees it.

A servo loop of real-time priority does not feel a busy machine; what carries its bytes does: the kernel serves
pseudo-terminals and USB adapters at ordinary priority. A process of its own, for in ours a thread would wait for the
interpreter's lock.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from typing import Final, Self

LOOK_S: Final = 1e-3
"""How long each thread sleeps; what is later than so long again is kept."""


class Witness:
    """A process that watches from ``with`` on."""

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,  # its end is the process's end, however ours comes
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for us alone
        )
        self.latest_s(0, time.monotonic_ns())  # it watches
        return self

    def __exit__(self, *exception: object) -> None:
        with contextlib.suppress(BrokenPipeError):
            self._process.communicate()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def latest_s(self, begin_ns: int, end_ns: int) -> float:
        """The most that a thread was late in a span of CLOCK_MONOTONIC, s; waits until all have woken after it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{begin_ns} {end_ns}\n")
        self._process.stdin.flush()
        return 1e-9 * int(self._process.stdout.readline())


class _Watcher(threading.Thread):
    """Sleeps on one processor, and notes how late it wakes."""

    def __init__(self, processor: int) -> None:
        super().__init__(daemon=True)
        self._processor = processor
        self.woke_ns = 0
        self._late: list[tuple[int, int]] = []

    def run(self) -> None:
        os.sched_setaffinity(0, {self._processor})  # of this thread alone
        while True:
            due = time.monotonic_ns() + round(LOOK_S * 1e9)
            time.sleep(LOOK_S)
            now = time.monotonic_ns()
            if now - due > 1e9 * LOOK_S:
                self._late.append((due, now))
            self.woke_ns = now

    def latest_ns(self, begin_ns: int, end_ns: int) -> int:
        return max((woke - due for due, woke in list(self._late) if woke > begin_ns and due < end_ns), default=0)


def main() -> None:
    """Answer each line ``BEGIN END`` on standard input with the most that was late meanwhile, ns."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    watchers = [_Watcher(processor) for processor in sorted(os.sched_getaffinity(0))]
    for watcher in watchers:
        watcher.start()
    for line in sys.stdin:
        begin_ns, end_ns = map(int, line.split())
        while min(watcher.woke_ns for watcher in watchers) <= end_ns:
            time.sleep(LOOK_S)
        print(max(watcher.latest_ns(begin_ns, end_ns) for watcher in watchers), flush=True)


if __name__ == "__main__":
    main()
