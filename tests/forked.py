"""A command of ours as a process of its own, forked from a server that has imported and loaded everything.

A start costs milliseconds instead of two seconds of processor time. Here is the part of ``subprocess.Popen``'s interface
that the tests use. The tests of the documentation start everything as a user does.
"""

from __future__ import annotations

import ctypes
import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import pytest

from hapticd.record.flight import SUFFIX, memory_directory

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    ["tests.sim_hw.forked_device", "tests.drivers.other_drive.__main__", "tests.service.forked_daemon", "tests.frozen"]
)
_PR_SET_PDEATHSIG = 1
_PROGRAMS = {
    "sim_hw": "sim_hw.__main__:main",
    "tests.drivers.other_drive": "tests.drivers.other_drive.__main__:main",
    "hapticd.cli": "hapticd.cli.main:main",
}


def start_server() -> None:
    """Have the server import and load while we do something else; the first process waits for it otherwise."""
    forkserver.ensure_running()


class Forked:
    """A process; ``stdout`` and ``stderr`` are text files on pipes.

    Args:
        program: ``module:function``, called with the arguments; what it returns is the exit code.
        arguments: what stands after the command's name. cwd: the child's working directory.
        environment: its variables, ours by default. output: file that takes what it prints in place of the pipes.
    """

    def __init__(
        self,
        program: str,
        arguments: Sequence[str],
        cwd: Path,
        environment: Mapping[str, str] | None = None,
        output: Path | None = None,
    ) -> None:
        ends = [_CONTEXT.Pipe(duplex=False) for _ in range(2)]
        self.stdout, self.stderr = (os.fdopen(os.dup(reader.fileno())) for reader, _ in ends)
        writers = [writer for _, writer in ends]
        variables = dict(os.environ if environment is None else environment)
        self._child = _CONTEXT.Process(
            target=_run, args=(program, list(arguments), str(cwd), variables, output and str(output), *writers)
        )
        self._child.start()
        for reader, writer in ends:
            reader.close()
            writer.close()
        if output is not None:
            self.stdout.close()
            self.stderr.close()
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

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def close(self) -> None:
        """End it at once, and forget what it printed and left in memory: each flight recorder has 21 MB."""
        self.kill()
        self.wait()
        if (memory := memory_directory()) is not None:
            for left in (*memory.glob(f"*-{self.pid}-*{SUFFIX}"), *memory.glob(f"*-{self.pid}.crash")):
                left.unlink(missing_ok=True)
        self.stdout.close()
        self.stderr.close()

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, when it has ended. Raises subprocess.TimeoutExpired."""
        self._child.join(timeout)
        if self._child.exitcode is None:
            raise subprocess.TimeoutExpired("forked", timeout or 0.0)
        return self._child.exitcode

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """What it printed, when it has ended. Raises subprocess.TimeoutExpired."""
        self.wait(timeout)
        with self.stdout, self.stderr:
            return self.stdout.read(), self.stderr.read()


def device(arguments: Sequence[str], cwd: Path) -> Forked:
    """A simulated device: what ``python -m sim_hw`` runs with these arguments."""
    return Forked(_PROGRAMS["sim_hw"], arguments, cwd)


def fork_what_hil_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Devices and daemons of `hapticd.hil` are forked instead of started, where a start is not what is tested."""
    from hapticd.hil import process

    names = {name: getattr(subprocess, name) for name in ("DEVNULL", "TimeoutExpired")}
    monkeypatch.setattr(process, "subprocess", SimpleNamespace(Popen=_popen, **names))


def _popen(command: list[str], *, stdout: BinaryIO, env: dict[str, str], **_: Any) -> Forked:
    """Popen as `hapticd.hil.process.Child` calls it: behind the tie to its parent stands ``python -m MODULE ARGUMENTS``."""
    begin = command.index(sys.executable, 1)
    _, module, *arguments = command[begin + 1 :]
    return Forked(_PROGRAMS[module], arguments, Path.cwd(), env, Path(stdout.name))


def _run(
    program: str,
    arguments: list[str],
    cwd: str,
    environment: dict[str, str],
    output: str | None,
    out: Connection,
    err: Connection,
) -> None:
    """The child's whole life; it ends with the server, which ends with us."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:0] = filter(None, environment.get("PYTHONPATH", "").split(":"))
    targets = [pipe.fileno() for pipe in (out, err)]
    if output is not None:
        targets = [os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)] * 2
    for number, target in zip((1, 2), targets, strict=True):
        os.dup2(target, number)
    out.close()
    err.close()
    module, _, function = program.partition(":")
    sys.exit(getattr(importlib.import_module(module), function)(arguments))
