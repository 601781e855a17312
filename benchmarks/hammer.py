"""API clients that hammer a daemon as fast as it answers: a process each, with several threads.

Kind ``query`` reads status, config and experiment in turn; ``set`` publishes a whole parameter set to the servo loop each
time, as far as any request can reach. A set waits until the loop has applied it, so how often it comes depends on the
servo rate: only queries load the machine alike while the loop runs and while it idles for the sake of a peer.

As a script (``python -m benchmarks.hammer SOCKET THREADS {query|set}``) it says ``ready`` after its first answer, goes on
until its stdin is closed, and prints how many requests were answered.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from hapticd.client import Client, RequestRefused

_TIMEOUT_S = 60.0

Kind = Literal["query", "set"]


class Hammer:
    """Hammers from ``with`` to its end; ``served`` (answers) and ``seconds`` are known afterwards."""

    def __init__(self, socket: Path, processes: int, threads: int, kind: Kind = "query") -> None:
        self.served = 0
        self.seconds = 0.0
        self._began = 0.0
        self._command = [sys.executable, "-m", "benchmarks.hammer", str(socket), str(threads), kind]
        self._count = processes
        self._processes: list[subprocess.Popen[str]] = []

    def __enter__(self) -> Hammer:
        for _ in range(self._count):
            process = subprocess.Popen(self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            self._processes.append(process)
        for process in self._processes:
            assert process.stdout is not None
            process.stdout.readline()
        self._began = time.monotonic()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.seconds = time.monotonic() - self._began
        for process in self._processes:
            self.served += int(process.communicate(timeout=_TIMEOUT_S)[0] or 0)


def _hammer(socket: Path, threads: int, kind: str) -> None:
    ending, ready = threading.Event(), threading.Event()
    served = [0] * threads

    def ask(index: int) -> None:
        client = Client(socket, _TIMEOUT_S)
        requests: list[Callable[[], Any]] = [client.status, client.config, client.experiment]
        if kind == "set":
            requests = [lambda: client.set({"spring.half_tick_bias": True})]
        while not ending.is_set():
            with suppress(RequestRefused):  # of commands in a flood some come to their turn too late
                requests[served[index] % len(requests)]()
                served[index] += 1
            ready.set()

    workers = [threading.Thread(target=ask, args=(index,)) for index in range(threads)]
    for worker in workers:
        worker.start()
    ready.wait()
    print("ready", flush=True)
    sys.stdin.read()
    ending.set()
    for worker in workers:
        worker.join()
    print(sum(served))


if __name__ == "__main__":
    _hammer(Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
