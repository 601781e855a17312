"""A loop on a device's clock: its ticks are the producer's, a SYNC that stays out is a period missed, many are a fault."""

from __future__ import annotations

import ctypes
import threading
import time
from typing import Any

import numpy as np
import pytest

from drivers import DriverConfigError, check_option_names
from drivers.interface import MISSED, OK, X_DEADLINE_NS
from hapticd.config import Config
from hapticd.servo import atomics
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters
from tests.polling import wait_until
from tests.service.daemons import undisturbed
from tests.servo.scripted import Scripted, config, fault_code

pytestmark = pytest.mark.realtime
RATE_HZ = 40.0
_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)


class Producer(Scripted):
    """A device whose clock is 1 % fast and jitters, and leaves out what it is told to."""

    follows_clock = True

    def __init__(self, cfg: Config, leaves_out: set[int]) -> None:
        super().__init__(cfg, lambda n: 100)
        self.period_ns = 0.99e9 / RATE_HZ
        self.begin_ns = time.monotonic_ns()
        self.leaves_out = leaves_out
        self.silent = False
        self.next = 1
        self.sent: list[int] = []
        self.late = 0
        self._wait_function = _FUNCTION(self._wait)

    def open(self) -> None:
        super().open()
        self.wait_address = ctypes.cast(self._wait_function, ctypes.c_void_p).value or 0

    def _due_ns(self, number: int) -> int:
        jitter = 0.1 * self.period_ns * ((number * 7) % 3 - 1)
        return self.begin_ns + int(number * self.period_ns + jitter)

    def _wait(self, _state: int, exchange: int) -> int:
        deadline = int((ctypes.c_int64 * 16).from_address(exchange)[X_DEADLINE_NS])
        while self.next in self.leaves_out or self._due_ns(self.next) < time.monotonic_ns() - self.period_ns:
            self.next += 1
        due = deadline if self.silent else self._due_ns(self.next)
        time.sleep(max(0.0, 1e-9 * (min(due, deadline) - time.monotonic_ns())))
        self.late += time.monotonic_ns() - due > 0.2 * self.period_ns
        if due >= deadline:
            return MISSED
        self.sent.append(self.next)
        self.next += 1
        return OK


def started(driver: Producer) -> tuple[ServoCore, threading.Thread]:
    driver.open()
    core = ServoCore(driver, ring_rows=1024, excitation_rows=1)
    core.publish(parameters(driver.config, Request(state=w.RUNNING)))
    core.begin(time.monotonic_ns())
    core.store(atomics.HEARTBEAT_NS, 2**62)
    thread = threading.Thread(target=lambda: core.run(real_time=True))
    thread.start()
    return core, thread


def settings() -> Config:
    return config(servo={"rate_hz": RATE_HZ, "overrun": {"fault_after": None}}, safety={"missed_exchanges": 3})


def test_ticks_are_the_producers() -> None:
    """A SYNC that is left out is one period missed, and the tick after it has the number that it would have had."""
    left_out = {12, 20, 21}

    def run() -> tuple[Producer, np.ndarray[Any, Any], int]:
        driver = Producer(settings(), left_out)
        core, thread = started(driver)
        wait_until(lambda: driver.next > 30, "thirty SYNC")
        core.store(atomics.STOP, 1)
        thread.join()
        return driver, core.drain(), core.load(atomics.MISSED_PERIODS)

    driver, rows, missed = undisturbed(run, lambda found: found[0].late)
    ticks = rows["tick"]
    assert np.array_equal(np.diff(ticks), np.diff(driver.sent[: len(ticks)]))
    assert missed == np.sum(np.diff(ticks) - 1) == len(left_out)
    assert np.all(np.abs(rows["wake_late_ns"][3:]) < 0.5 * driver.period_ns)
    assert rows["current_command_A"][-1] != 0.0


def test_a_producer_that_falls_silent_is_a_fault_at_zero_current() -> None:
    driver = Producer(settings(), set())
    core, thread = started(driver)
    wait_until(lambda: bool(driver.commands) and driver.commands[-1][0] != 0.0, "a current")
    driver.silent = True
    wait_until(lambda: fault_code(core) is not None, "a fault")
    done = len(driver.commands)
    wait_until(lambda: len(driver.commands) > done + 2, "ticks all the same")
    core.store(atomics.STOP, 1)
    thread.join()
    assert fault_code(core) == "sync_lost"
    value, limit = core.fault_numbers
    assert value > limit == 3
    assert set(driver.commands[done + 1 :]) == {(0.0, False)}


def test_a_driver_without_a_clock_is_refused() -> None:
    with pytest.raises(
        DriverConfigError, match=r"servo.clock = sync: driver loopback has no SYNC.*these have one: canopen"
    ):
        check_option_names(config(servo={"clock": "sync"}))
