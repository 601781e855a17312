"""The lines that ``hapticd run`` begins with."""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from hapticd.service.foreground import banner, live_line, log_to
from hapticd.service.latch import FaultLatch
from hapticd.service.sink import Sink
from tests.polling import PATIENCE_S
from tests.service.daemons import SOCKET, daemon_on, state_home

__all__ = ["state_home"]


@pytest.mark.parametrize(("stiffness", "numbers"), [(0.012, "μ 523.3  β 0.75 "), (0.0, "μ ∞  β ∞  σ ∞ ")])
def test_operating_point_with_a_spring_and_without(
    stiffness: float, numbers: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, spring={"stiffness": stiffness}) as (daemon, _devices):
        (line,) = (line for line in banner(daemon, SOCKET, "rig.yaml") if line.startswith("operating"))
    assert numbers in line


def test_the_motor_is_not_called_off_where_it_is_about_to_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _devices):
        waiting, starting = (banner(daemon, SOCKET, "rig.yaml", starting=start)[-1] for start in (False, True))
    assert waiting.startswith("motor       off")
    assert starting.startswith("motor       on in a moment, as --start asks")


def test_a_folder_that_takes_no_recordings_is_said_at_the_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _devices):
        assert not any("no run can be recorded" in line for line in banner(daemon, SOCKET, "rig.yaml"))
        assert not (tmp_path / "runs").exists()
        (tmp_path / "runs").write_text("in the way")
        (line,) = (line for line in banner(daemon, SOCKET, "rig.yaml") if "no run can be recorded" in line)
    assert line.startswith("WARNING")
    assert f"no run can be recorded: {tmp_path / 'runs'} is not a folder" in line


def test_a_folder_that_keeps_no_fault_is_said_at_the_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, state_home: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _devices):
        assert not any("outlive a restart" in line for line in banner(daemon, SOCKET, "rig.yaml"))
        (state_home / "hapticd").rename(state_home / "away")
        (state_home / "hapticd").write_text("in the way")
        (line,) = (line for line in banner(daemon, SOCKET, "rig.yaml") if "outlive a restart" in line)
        (state_home / "hapticd").unlink()
    assert line.startswith("WARNING     a fault would not outlive a restart: ")
    assert f"{FaultLatch(SOCKET).path} cannot be written, {state_home / 'hapticd'} is not a folder" in line
    assert "$XDG_STATE_HOME" in line


def test_limits_that_are_off_are_said_at_the_start(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    safety = {"max_velocity": 0, "max_excursion": -0.0, "encoder_jump": None}
    with daemon_on(monkeypatch, tmp_path, safety=safety, servo={"overrun": {"fault_after": 10}}) as (daemon, _devices):
        (line,) = (line for line in banner(daemon, SOCKET, "rig.yaml") if "limits that are off" in line)
        assert daemon.status()["limits_off"] == [f"safety.{key}" for key in safety]
    assert line.startswith("WARNING")
    assert line.endswith("safety.max_velocity, safety.max_excursion, safety.encoder_jump")


def test_a_log_line_on_a_terminal_says_its_level_once() -> None:
    root, sink = logging.getLogger(), Sink()
    before, root.handlers = root.handlers, []
    try:
        written = io.StringIO()
        log_to(Console(file=written, force_terminal=True, no_color=True, width=100), sink)
        (handler,) = root.handlers
        handler.handle(logging.LogRecord("hapticd", logging.WARNING, "", 0, "the disk is nearly full", None, None))
    finally:
        root.handlers = before
        sink.end(PATIENCE_S)
    assert written.getvalue().count("WARNING") == 1
    assert "the disk is nearly full" in written.getvalue()


def test_the_live_line_says_once_that_the_recording_stopped() -> None:
    status: dict[str, Any] = {
        "state": "off",
        "position_ticks": 0.0,
        "current": 0.0,
        "fault": None,
        "timing": {"ticks": 1, "missed": 0, "wake_us": {"p50": None}},
        "recorder": {"path": None, "error": "recording stopped: the disk is full"},
    }
    assert live_line(status).endswith("  recording stopped: the disk is full")
    assert live_line(status).lower().count("recording") == 1
