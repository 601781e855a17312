"""A command line run in this process, and a daemon's stand-in for it to talk to."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from hapticd.cli.main import main
from hapticd.client import Client

from ..service.fake_control import FakeControl, renew, serve


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


@pytest.fixture(scope="package")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[FakeControl, Client]]:
    """The stand-in for the daemon, answering: one for all tests."""
    control = FakeControl()
    with serve(control, tmp_path_factory.mktemp("cli") / "h.sock") as client:
        yield control, client


@pytest.fixture
def control(served: tuple[FakeControl, Client]) -> FakeControl:
    """The same, as at its start."""
    renew(*served)
    return served[0]


@pytest.fixture
def daemon(
    served: tuple[FakeControl, Client], control: FakeControl, hapticd: Run, monkeypatch: pytest.MonkeyPatch
) -> Run:
    """Run one command line with a daemon answering on HAPTICD_SOCKET."""
    monkeypatch.setenv("HAPTICD_SOCKET", str(served[1].socket_path))
    return hapticd
