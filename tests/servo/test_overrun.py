"""`servo.overrun.fault_after` counts the periods of a stretch of late ticks: a freeze weighs as much as many late ticks."""

from __future__ import annotations

import time

import pytest

from hapticd.config import Config
from hapticd.servo import atomics
from hapticd.servo import layout as w
from hapticd.servo.core import ServoCore
from tests.servo.scripted import Scripted, config, core_for, fault_code


def after_freezes(
    rate_hz: float, fault_after: int | None, freezes: dict[int, float], state: int = w.RUNNING
) -> ServoCore:
    """The loop on the real clock; at the samples that are named the whole thread stands still for so many seconds."""
    last = max(freezes) + 20
    overrun = {} if fault_after is None else {"overrun": {"fault_after": fault_after}}
    cores: list[ServoCore] = []

    def counts(n: int) -> int:
        time.sleep(freezes.get(n, 0.0))
        if n == last:
            cores[0].store(atomics.STOP, 1)
        return 100

    cfg = config(servo={"rate_hz": rate_hz, **overrun}, safety={"heartbeat_timeout_s": 10})
    driver = Scripted(cfg, counts)
    core = core_for(driver, cfg, state)
    cores.append(core)
    core.store(atomics.HEARTBEAT_NS, time.monotonic_ns())
    core.begin(time.monotonic_ns() + 1_000_000)
    core.run(real_time=True)
    if state == w.RUNNING and fault_code(core):
        assert driver.commands[-1] == (0.0, False)
    return core


def test_a_freeze_of_a_tenth_of_a_second_is_a_fault_by_default() -> None:
    core = after_freezes(1000.0, None, {20: 0.1})
    assert fault_code(core) == "overrun"
    value, limit = core.fault_numbers
    assert limit == Config().servo.overrun.fault_after
    assert value >= 90.0
    assert value <= core.load(atomics.MISSED_PERIODS)


def test_freezes_with_ticks_in_time_between_them_do_not_add_up() -> None:
    core = after_freezes(100.0, 15, {20: 0.1, 40: 0.1, 60: 0.1})
    assert core.load(atomics.MISSED_PERIODS) >= 24
    assert fault_code(core) is None


@pytest.mark.parametrize("state", [w.OFF, w.READY])
def test_a_freeze_while_nothing_is_rendered_is_none(state: int) -> None:
    core = after_freezes(1000.0, None, {20: 0.2}, state)
    assert core.load(atomics.MISSED_PERIODS) >= 150
    assert fault_code(core) is None


def test_a_freeze_before_running_is_not_held_against_it() -> None:
    """It ends in the tick in which running begins."""
    core = after_freezes(100.0, 15, {0: 0.5})
    assert core.load(atomics.MODE) == w.RUNNING
    assert core.load(atomics.MISSED_PERIODS) >= 40
