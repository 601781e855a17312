"""A daemon to measure: a process of its own, driven through its socket like by any client."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from benchmarks.report import BenchmarkError
from hapticd.client import Client, DaemonUnreachable
from hapticd.record import Run, read_run

if TYPE_CHECKING:
    from numpy.typing import NDArray

_START_S = 600.0
"""The first start on a machine compiles the loop."""
_UNTRIPPED = {"safety.heartbeat_timeout_s": "10", "servo.overrun.fault_after": "null"}
"""The two trips that judge how loaded the machine is would end what is to be measured."""


class MeasuredDaemon:
    """``hapticd run`` with the given settings, from ``with`` to its end; rendering, and recording only on request.

    Args:
        settings: dotted config keys and their values.
        busy: keep one Python thread of the daemon's process computing without end.

    Raises:
        BenchmarkError: the daemon does not start; its last words are in the text.
    """

    def __init__(self, settings: dict[str, str], busy: bool = False) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="hapticd-benchmark-")
        self.folder = Path(self._folder.name)
        self.socket = self.folder / "s.sock"
        self.client = Client(self.socket)
        arguments = ["run", "--socket", str(self.socket)]
        for key, value in {**_UNTRIPPED, "record.enabled": "false", **settings}.items():
            arguments += ["--set", f"{key}={value}"]
        self._log = self.folder / "log"
        self._threads = self.folder / "threads.json"
        self._command = [sys.executable, "-m", "benchmarks.daemon_process", str(self._threads)]
        self._command += ["busy" if busy else "calm", *arguments]
        self._environment = {**os.environ, "XDG_STATE_HOME": str(self.folder)}

    def __enter__(self) -> Self:
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=self._environment
            )
        try:
            self._wait_for_answer()
            self.client.start()
        except BaseException:
            self._forget()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._forget()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def set_rate(self, rate_hz: float) -> None:
        """Change the servo rate live."""
        self.client.set({"servo.rate_hz": rate_hz})

    def new_path(self) -> Path:
        """Where a recording may go; it lives as long as the daemon."""
        return self.folder / f"{time.monotonic_ns()}.arrow"

    def record(self, seconds: float) -> Run:
        """Record for so long."""
        path = self.new_path()
        self.client.record_start(path)
        time.sleep(seconds)
        self.client.record_stop()
        run = read_run(path)
        path.unlink()
        return run

    def thread_id(self, name: str) -> int:
        """The kernel's number of a thread."""
        while not self._threads.exists():
            time.sleep(0.05)
        number: int = json.loads(self._threads.read_text())[name]
        return number

    def thread_cpu_s(self, name: str) -> float:
        """CPU time that one thread has used so far, s."""
        return self._cpu_s(self.thread_id(name))

    def cpu_s(self) -> float:
        """CPU time that all threads which live have used so far, s."""
        return sum(self._cpu_s(int(task.name)) for task in Path(f"/proc/{self.pid}/task").iterdir())

    def _cpu_s(self, thread: int) -> float:
        return int(Path(f"/proc/{self.pid}/task/{thread}/schedstat").read_text().split()[0]) * 1e-9

    def require_healthy(self) -> dict[str, Any]:
        """The status, when the loop still renders.

        Raises:
            BenchmarkError: it faulted, so what was measured is not what was meant.
        """
        status = self.client.status()
        if status["state"] != "running":
            raise BenchmarkError(f"the daemon left 'running': state {status['state']}, fault {status['fault']}")
        return status

    def _wait_for_answer(self) -> None:
        deadline = time.monotonic() + _START_S
        while True:
            try:
                self.client.status()
                return
            except DaemonUnreachable:
                if self._process.poll() is not None or time.monotonic() > deadline:
                    words = self._log.read_text(errors="replace")[-2000:]
                    raise BenchmarkError(f"the daemon did not start; its last words:\n{words}") from None
                time.sleep(0.1)

    def end(self) -> str:
        """End the process, if it still runs; returns what it printed."""
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(20.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        return self._log.read_text(errors="replace")

    def _forget(self) -> None:
        self.end()
        self._folder.cleanup()


def lateness_ns(run: Run, rate_hz: float) -> NDArray[np.float64]:
    """How late each tick woke, ns; a row keeps the part beyond whole missed periods, which the tick numbers give back."""
    late = np.asarray(run.columns["wake_late_ns"], dtype=np.float64)
    missed = np.diff(run.columns["tick"], prepend=run.columns["tick"][:1] - 1) - 1
    return late + missed * (1e9 / rate_hz)


def quantile_us(samples_ns: NDArray[np.float64], q: float) -> float:
    """A quantile of durations, µs."""
    return float(np.quantile(samples_ns, q)) / 1e3
