"""The supervisor's heartbeat: whose silence is a fault, whoever wakes first."""

from __future__ import annotations

import time
from collections.abc import Callable

from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters
from hapticd.servo.thread import ServoThread
from tests.polling import wait_until
from tests.servo.scripted import Scripted, config, fault_code

TIMEOUT_S = 0.5


def core_after(stand_still: Callable[[ServoThread], None]) -> ServoCore:
    """The loop rendered, with a heartbeat in each tick; in one of them it stood still."""

    def counts(n: int) -> int:
        if n == 30:
            stand_still(servo)
        servo.beat()
        return 100

    cfg = config(safety={"heartbeat_timeout_s": TIMEOUT_S}, servo={"overrun": {"fault_after": None}})
    driver = Scripted(cfg, counts)
    driver.open()
    servo = ServoThread(cfg, driver, parameters(cfg, Request(state=w.RUNNING)))
    servo.start()
    wait_until(lambda: driver.samples > 60, "samples after it stood still")
    servo.stop()
    assert any(current != 0.0 for current, _ in driver.commands)
    return servo.core


def test_a_frozen_process_cannot_hide_the_silence_of_its_supervisor() -> None:
    """Both stand still, and the supervisor wakes first."""
    core = core_after(lambda servo: time.sleep(2.0 * TIMEOUT_S))
    assert fault_code(core) == "heartbeat_lost"
    assert core.fault_numbers[0] >= 2e3 * TIMEOUT_S


def test_a_loop_that_stands_still_alone_is_not_the_supervisors_silence() -> None:
    def beating(servo: ServoThread) -> None:
        for _ in range(50):
            time.sleep(0.04 * TIMEOUT_S)
            servo.beat()

    assert fault_code(core_after(beating)) is None
