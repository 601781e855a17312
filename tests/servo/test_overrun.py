"""`servo.overrun.fault_after` counts missed periods, less the ticks in time: who is late most of the time trips, however."""

from __future__ import annotations

import time
from typing import Any

import numba
import numpy as np
import pytest

from hapticd.config import Config
from hapticd.jit import njit
from hapticd.servo import atomics
from hapticd.servo import layout as w
from hapticd.servo.core import ServoCore
from hapticd.servo.gate import check_load, count_late
from hapticd.servo.layout import SERVO
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


def test_short_freezes_that_fill_most_of_the_time_are_a_fault() -> None:
    """45 ms frozen, 4 ms not: each for itself is no fault."""
    core = after_freezes(1000.0, None, dict.fromkeys(range(20, 60, 4), 0.045))
    assert fault_code(core) == "overrun"


@njit(numba.int64(numba.from_dtype(SERVO), numba.int64[::1], numba.int64[::1]), counted=False)
def _play(servo: Any, shared: Any, missed: Any) -> int:
    """The counting of ticks that missed so many periods before them; the period in which it trips, -1 for none."""
    period = 0
    for each in missed:
        servo.tick.missed = each
        period += each + 1
        count_late(servo)
        check_load(servo, shared)
        if servo.state.mode == w.FAULT:
            return period
    return -1


def trips_at(missed: list[int], **overrun: Any) -> int:
    """The period of a run in virtual time in which it is a fault; -1: in none."""
    cfg = config(servo={"overrun": overrun})
    core = core_for(Scripted(cfg), cfg)
    core.run(real_time=False, ticks=20)
    assert core.load(atomics.MODE) == w.RUNNING
    return int(_play(core.memory[0], core.shared, np.array(missed, np.int64)))


CYCLES = 10_000


@pytest.mark.parametrize("in_time", [1, 4, 40])
@pytest.mark.parametrize("duty", [0.92, 0.6, 0.5])
def test_late_most_of_the_time_is_a_fault_however_short_each_freeze_is(duty: float, in_time: int) -> None:
    frozen = max(1, round(in_time * duty / (1.0 - duty)))
    at = trips_at([frozen, *[0] * (in_time - 1)] * CYCLES)
    excess = (frozen - in_time + 1) / (frozen + in_time)
    assert 0 < at <= 50 / excess + 2 * (frozen + in_time)


@pytest.mark.parametrize(
    "missed", [[1, 0], [1] + [0] * 20, [20] + [0] * 20, [49] + [0] * 60, [0, 3, 0, 0, 0, 1, 0]], ids=str
)
def test_late_now_and_then_never_adds_up(missed: list[int]) -> None:
    assert trips_at(missed * CYCLES) == -1


def test_one_stretch_of_late_ticks_is_a_fault_at_the_limit() -> None:
    assert trips_at([24, 25]) == -1
    assert trips_at([24, 26]) == 52
    assert trips_at([0, 0, 50]) == 53
    assert trips_at([10_000], fault_after=0) == -1


def test_the_policy_fault_knows_no_count() -> None:
    assert trips_at([0, 1, 0], policy="fault") == 3


def test_freezes_with_as_many_ticks_in_time_between_them_do_not_add_up() -> None:
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
