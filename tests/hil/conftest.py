"""Devices and daemons of the suite forked instead of started, where a start is not what is tested."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import pytest

from hapticd.hil import process
from tests.forked import Forked

PROGRAMS = {"sim_hw": "sim_hw.__main__:main", "hapticd.cli": "hapticd.cli.main:main"}


def _fork(command: list[str], *, stdout: BinaryIO, env: dict[str, str], **_: Any) -> Forked:
    """Popen as ``Child`` calls it: behind the tie to its parent stands ``python -m MODULE ARGUMENTS``."""
    begin = command.index(sys.executable, 1)
    _, module, *arguments = command[begin + 1 :]
    return Forked(PROGRAMS[module], arguments, Path.cwd(), env, Path(stdout.name))


@pytest.fixture
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes of the suite begin in milliseconds."""
    names = {name: getattr(subprocess, name) for name in ("DEVNULL", "TimeoutExpired")}
    monkeypatch.setattr(process, "subprocess", SimpleNamespace(Popen=_fork, **names))
