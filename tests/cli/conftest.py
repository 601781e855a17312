"""A command line run in this process, and a daemon's stand-in for it to talk to."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from hapticd.cli.main import main

from ..service.fake_control import FakeControl, serve


@dataclass(frozen=True)
class Outcome:
    """What a command left: exit code, stdout, stderr."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> Any:
        """The one JSON document on stdout; fails when there is anything else."""
        return json.loads(self.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


Run = Callable[..., Outcome]


@pytest.fixture
def hapticd(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run one command line."""
    monkeypatch.delenv("HAPTICD_SOCKET", raising=False)
    monkeypatch.setenv("COLUMNS", "100")

    def run(*words: str) -> Outcome:
        capsys.readouterr()
        code = main(words)
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return run


@pytest.fixture
def control() -> FakeControl:
    """The stand-in for the daemon."""
    return FakeControl()


@pytest.fixture
def daemon(control: FakeControl, hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    """Run one command line with a daemon answering on HAPTICD_SOCKET."""
    with serve(control, tmp_path / "h.sock"):
        monkeypatch.setenv("HAPTICD_SOCKET", str(tmp_path / "h.sock"))
        yield hapticd
