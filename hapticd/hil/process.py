"""A child process whose output is kept, that is waited for, and that never outlives us."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

from hapticd.hil.errors import HilError

_LAST_WORDS = 12
_END_S = 20.0
_TIED = """
import ctypes, os, sys
parent, *command = sys.argv[1:]
if ctypes.CDLL(None, use_errno=True).prctl(1, 9) != 0:
    sys.exit(f"prctl: {os.strerror(ctypes.get_errno())}")
if os.getppid() != int(parent):
    sys.exit("the suite has ended")
os.execvp(command[0], command)
"""
"""What stands before every command: PR_SET_PDEATHSIG (1) with SIGKILL (9) ties the process to ours, however ours ends, and
outlives execve; a parent that was gone before it took effect is noticed."""


class Child:
    """A process of this suite.

    Args:
        name: what to call it in messages.
        command: program and arguments.
        log: file that takes its standard output and error.
        environment: variables on top of ours.
    """

    def __init__(self, name: str, command: Sequence[str], log: Path, environment: dict[str, str] | None = None) -> None:
        self.name = name
        self.log = log
        self.command = command
        self._environment = {**os.environ, **(environment or {}), "PYTHONUNBUFFERED": "1"}
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        with self.log.open("wb") as out:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _TIED, str(os.getpid()), *self.command],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=out,
                env=self._environment,
                # Ctrl-C and the end of a terminal are for us alone: we end our processes, in our order.
                start_new_session=True,
            )
        return self

    def __exit__(self, *exception: object) -> None:
        self.end()

    def add_environment(self, variables: dict[str, str]) -> None:
        """Variables for a process that is not yet started."""
        self._environment |= variables

    @property
    def pid(self) -> int:
        """Process id."""
        assert self._process is not None
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._process is not None and self._process.poll() is None

    def wait_until(self, condition: Callable[[], bool], what: str, timeout_s: float) -> None:
        """Poll until something is so.

        Raises:
            HilError: the process ended first, or the time is over.
        """
        deadline = time.monotonic() + timeout_s
        while not condition():
            if not self.running:
                raise HilError(f"{self.name} ended with code {self.code} before {what}:\n{self.last_output()}")
            if time.monotonic() > deadline:
                raise HilError(f"{self.name}: waited {timeout_s:g} s in vain for {what}:\n{self.last_output()}")
            time.sleep(0.01)

    @property
    def code(self) -> int | None:
        """Exit code, minus the signal's number when a signal ended it."""
        return None if self._process is None else self._process.poll()

    def signal(self, number: int) -> None:
        """Send a signal."""
        os.kill(self.pid, number)

    def end(self) -> None:
        """SIGTERM, and SIGKILL when that is not enough."""
        process = self._process
        if process is None or process.poll() is not None:
            return
        process.send_signal(signal.SIGCONT)  # a stopped process hears no SIGTERM
        process.terminate()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def last_output(self) -> str:
        """The last lines of its output."""
        lines = self.log.read_text(errors="replace").splitlines()
        return "\n".join(lines[-_LAST_WORDS:]) or "(it said nothing)"
