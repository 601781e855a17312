"""A wrong sign is named by its run-away; an unstable spring, a fast release and a hand are not taken for it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from drivers import PythonDriver
from hapticd.config import Config, parse_config
from hapticd.servo import atomics, faults, run_away
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters

INERTIA, CONSTANT = 6.28e-6, 0.0292
PUSHED_FROM = 200
"""Ticks; a spring of 0.012 N m/rad has swung once and more by then."""


class Shaft(PythonDriver):
    """A free shaft that starts away from the origin, in virtual time: one step a read."""

    def __init__(self, config: Config, sign: float, start: float, push: float = 0.0) -> None:
        super().__init__(config)
        self._sign, self._position, self._push = sign, start, push
        self._speed = self._current = 0.0
        self._reads = 0

    def connect(self) -> None:
        """Nothing to connect to."""

    def disconnect(self) -> None:
        """Nothing to leave."""

    def read_counts(self) -> int:
        self._reads += 1
        push = self._push if self._reads > PUSHED_FROM else 0.0
        torque = self._sign * CONSTANT * self._current + push
        self._speed += self.config.period / INERTIA * torque
        self._position += self.config.period * self._speed
        return math.floor(self._position / self.config.raw_resolution)

    def write_current(self, current: float, enable: bool) -> None:
        self._current = current


def ended(sign: float, start: float, push: float = 0.0, **spring: Any) -> tuple[int, str | None]:
    """The fault in which a shaft ends, and what its last rows add."""
    config = parse_config(
        {
            "spring": {"stiffness": 0.012, **spring},
            "safety": {"max_velocity": 100, "max_excursion": 30, "encoder_jump": None, "soft_start_s": 0},
            "amplifier": {"dac_bits": 0, "continuous_current": 0},
        },
        "test",
    )
    driver = Shaft(config, sign, start, push)
    driver.open()
    core = ServoCore(driver, ring_rows=4096, excitation_rows=1)
    core.publish(parameters(config, Request(state=w.RUNNING)))
    core.begin(0)
    number = faults.NONE
    for _ in range(100):  # the supervisor looks every 50 ms
        core.run(real_time=False, ticks=50)
        if number := int(core.load(atomics.FAULT_CODE)):
            break
    return number, run_away.detail(number, core, config.origin_counts)


@pytest.mark.parametrize("start", [0.001, -0.3, 2.0])
def test_a_wrong_sign_is_named(start: float) -> None:
    number, said = ended(-1.0, start)
    assert number in (faults.OVER_SPEED, faults.EXCURSION)
    assert said is not None
    assert "most likely the sign is wrong (encoder.invert, or the motor's leads)" in said


def test_a_release_that_is_too_fast_is_no_wrong_sign() -> None:
    assert ended(1.0, 6.0) == (faults.OVER_SPEED, None)


def test_an_unstable_spring_is_no_wrong_sign() -> None:
    assert ended(1.0, 0.5, stiffness=1.0) == (faults.OVER_SPEED, None)


def test_a_hand_that_pulls_after_a_while_is_no_wrong_sign() -> None:
    """One that pulls from the first tick on is told from a wrong sign by nobody."""
    number, said = ended(1.0, 1.0, push=0.2)
    assert number in (faults.OVER_SPEED, faults.EXCURSION)
    assert said is None
