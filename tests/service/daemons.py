"""A daemon on a device that writes down what it is told, in a state folder of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest

import drivers
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from tests.polling import wait_until
from tests.servo.scripted import Scripted, config

SOCKET = Path("test.sock")
ATTEMPTS = 6
Found = TypeVar("Found")


def wait_for_state(daemon: Daemon, state: str) -> dict[str, Any]:
    """Wait for a state and return the status."""
    wait_until(lambda: daemon.status()["state"] == state, f"state {state}")
    return daemon.status()


def undisturbed(run: Callable[[], Found], missed: Callable[[Found], int]) -> Found:
    """What a run in real time found; it is repeated where the machine missed periods or exchanges in it.

    Such a run is another experiment. The machine, not the outcome, decides that; where it never gives an undisturbed run,
    nothing can be said, and the test is skipped.
    """
    for _ in range(ATTEMPTS):
        found = run()
        if missed(found) == 0:
            return found
    pytest.skip(f"this machine missed periods in each of {ATTEMPTS} runs: no statement")


@pytest.fixture(autouse=True)
def state_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Faults and recordings of a test stay in its own folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    return tmp_path


@contextmanager
def daemon_on(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    script: Callable[[int], int | Exception | None] | None = None,
    **sections: Any,
) -> Iterator[tuple[Daemon, list[Scripted]]]:
    """A daemon and the list of devices it has opened (more than one after a reload); no script: the loopback."""
    opened: list[Scripted] = []

    def create(cfg: Any) -> Scripted:
        assert script is not None
        opened.append(Scripted(cfg, script))
        return opened[-1]

    if script is not None:
        monkeypatch.setattr(drivers, "create", create)
    sections.setdefault("record", {})["directory"] = str(tmp_path / "runs")
    sections["servo"] = {"overrun": {"fault_after": None}, **sections.get("servo", {})}
    # On a busy machine the supervisor may get no processor for longer than the half second that it has by default.
    sections["safety"] = {"heartbeat_timeout_s": 10, **sections.get("safety", {})}
    daemon = Daemon(config(**sections), None, FaultLatch(SOCKET))
    try:
        yield daemon, opened
    finally:
        daemon.shutdown()
