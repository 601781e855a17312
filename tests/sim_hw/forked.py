"""``python -m sim_hw …`` as a process of its own, forked from a server that has imported and loaded everything.

A start costs milliseconds instead of two seconds of processor time. Here is the part of ``subprocess.Popen``'s interface
that the tests use. The tests of ``hapticd hil`` start devices as a user does.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["tests.sim_hw.forked_device"])


class ForkedDevice:
    """A simulated device; ``stdout`` and ``stderr`` are text files on pipes.

    Args:
        arguments: what stands after ``python -m sim_hw``. cwd: the child's working directory.
    """

    def __init__(self, arguments: Sequence[str], cwd: Path) -> None:
        from tests.sim_hw.forked_device import run

        ends = [_CONTEXT.Pipe(duplex=False) for _ in range(2)]
        self.stdout, self.stderr = (os.fdopen(os.dup(reader.fileno())) for reader, _ in ends)
        writers: list[Connection] = [writer for _, writer in ends]
        self._child = _CONTEXT.Process(target=run, args=(list(arguments), str(cwd), *writers))
        self._child.start()
        for reader, writer in ends:
            reader.close()
            writer.close()
        assert self._child.pid is not None
        self.pid = self._child.pid

    @property
    def returncode(self) -> int | None:
        """Exit code, −N for a signal N; None while it runs."""
        return self._child.exitcode

    def poll(self) -> int | None:
        """The exit code, or None while it runs."""
        return self._child.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal; nothing when it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def close(self) -> None:
        """End it at once, and forget what it printed."""
        self.send_signal(signal.SIGKILL)
        self.wait()
        self.stdout.close()
        self.stderr.close()

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, when it has ended. Raises subprocess.TimeoutExpired."""
        self._child.join(timeout)
        if self._child.exitcode is None:
            raise subprocess.TimeoutExpired("sim_hw", timeout or 0.0)
        return self._child.exitcode

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """What it printed, when it has ended. Raises subprocess.TimeoutExpired."""
        self.wait(timeout)
        with self.stdout, self.stderr:
            return self.stdout.read(), self.stderr.read()
