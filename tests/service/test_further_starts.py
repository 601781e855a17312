"""A spring that was admitted, and of which a start is found later that moves on: its force goes softly, then a fault."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.service import further_starts
from hapticd.service.refusals import Refused
from hapticd.servo import atomics, layout
from hapticd.servo.core import Request, ServoCore, parameters
from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home, wait_for_state
from tests.servo.scripted import Scripted, config, fault_code

__all__ = ["state_home"]

SOFT = 50
"""Ticks."""
FAULT = (17, 3.5, -1.25)


def rendering(**changes: Any) -> tuple[Scripted, ServoCore]:
    """A loop that renders a spring off its origin, its soft start over."""
    driver = Scripted(config(safety={"soft_start_s": SOFT * 1e-3}), lambda n: 100)
    driver.open()
    core = ServoCore(driver, ring_rows=1024, excitation_rows=1)
    core.publish(parameters(driver.config, Request(state=layout.RUNNING)))
    core.begin(0)
    core.run(real_time=False, ticks=2 * SOFT)
    core.drain()
    core.publish(parameters(driver.config, Request(state=layout.RUNNING, **changes)))
    core.run(real_time=False, ticks=2 * SOFT)
    return driver, core


def test_the_force_fades_in_equal_steps_and_the_loop_goes_on_at_zero() -> None:
    _, core = rendering(faded=True)
    current = np.abs(core.drain()["current_command_A"])
    assert current[0] > 0.0
    assert current[-1] == 0.0
    steps = -np.diff(current)
    assert np.all(steps >= 0.0)
    assert steps.max() <= 1.05 * current[0] / SOFT
    assert core.load(atomics.MODE) == layout.RUNNING


def test_a_fault_that_is_asked_for_is_raised_with_its_numbers_where_it_renders() -> None:
    driver, core = rendering(fault=FAULT)
    assert fault_code(core) == "unstable"
    assert atomics.fault_numbers(core.shared) == FAULT[1:]
    assert driver.commands[-1] == (0.0, False)


def test_it_is_not_raised_where_nothing_is_rendered() -> None:
    driver = Scripted(config(), lambda n: 100)
    driver.open()
    core = ServoCore(driver, ring_rows=1024, excitation_rows=1)
    core.publish(parameters(driver.config, Request(fault=FAULT)))
    core.begin(0)
    core.run(real_time=False, ticks=5)
    assert fault_code(core) is None


class Found:
    """What an exploration has found."""

    def __init__(self, starts: int, moving_on: int) -> None:
        self.starts, self.moving_on, self.words = starts, moving_on, f"{moving_on} of {starts} starts moved on"
        self.worst_start = (3.5, -1.25) if moving_on else None

    def command(self, period_s: float) -> str:
        return "hapticd simulate"


@pytest.mark.realtime
def test_a_start_that_moves_on_is_found_while_it_is_rendered(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    asked: list[int] = []

    def explore_further(*_: Any, skip: int, **__: Any) -> Found:
        asked.append(skip)
        return Found(512, int(skip >= 1024))

    monkeypatch.setattr(further_starts, "explore_further", explore_further)
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, _):
        assert daemon.start()["guard"]["verdict"] == "admitted"
        fault = wait_for_state(daemon, "fault")["fault"]
        assert fault["code"] == "unstable"
        assert "3.5 ticks from the origin, at -1.25 ticks per period" in fault["cause"]
        assert asked == [0, 512, 1024]
        assert "hapticd simulate" in caplog.text
        daemon.clear()
        assert daemon.rig.request.fault[0] == 0
        assert not daemon.rig.request.faded


@pytest.mark.realtime
def test_nothing_is_searched_for_what_was_forced(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(further_starts, "explore_further", lambda *_, **__: Found(1, 1))
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, _):
        daemon.start()
        assert daemon._rendering.judged is not None
        daemon._rendering.judged = (*daemon._rendering.judged[:2], False)  # as after a start with force
        before = daemon.rig.core.load(atomics.TICKS)
        wait_until(lambda: daemon.rig.core.load(atomics.TICKS) > before + 1500, "a second and a half")
        assert daemon.status()["state"] == "running"


@pytest.mark.realtime
def test_neither_a_refused_nor_a_harmless_setting_ends_the_search(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[int] = []

    def explore_further(*_: Any, skip: int, **__: Any) -> Found:
        asked.append(skip)
        return Found(512, 0)

    monkeypatch.setattr(further_starts, "explore_further", explore_further)
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, _):
        daemon.start()
        with pytest.raises(Refused):
            daemon.set({"spring.stiffness": 5.0})
        daemon.set({"safety.max_velocity": 90.0})
        seen = len(asked)
        wait_until(lambda: len(asked) > seen + 1, "two more searches")
        assert asked == list(range(0, 512 * len(asked), 512))
