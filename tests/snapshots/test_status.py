"""The keys of the daemon's status and the names of its metrics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from syrupy.assertion import SnapshotAssertion

from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home

__all__ = ["state_home"]

pytestmark = pytest.mark.realtime


def _keys(value: Any) -> Any:
    """Names and kinds, without the values."""
    if isinstance(value, dict):
        return {key: _keys(inner) for key, inner in value.items()}
    return "number" if isinstance(value, int | float) and not isinstance(value, bool) else type(value).__name__


def test_status(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, snapshot: SnapshotAssertion) -> None:
    """Running on the loopback, and after a software stop."""
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        daemon.start()
        wait_until(lambda: daemon.status()["timing"]["ticks"] > 20, "ticks")
        running = daemon.status()
        daemon.estop()
        wait_until(lambda: (daemon.status()["fault"] or {}).get("time") is not None, "the fault latched")
        fault = daemon.status()["fault"]
    assert running["state"] == "running"
    told = fault | _keys({key: fault[key] for key in ("time", "config_digest")})
    assert {"running": _keys(running), "fault": told} == snapshot
