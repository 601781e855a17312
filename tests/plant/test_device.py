"""The Python object: seconds instead of instants, the hand's schedule, and clear refusals."""

from __future__ import annotations

import doctest
import math

import pytest

from hapticd.config import parse_config
from hapticd.plant import device, kernel
from hapticd.plant.device import Plant, split_time
from hapticd.plant.exact import propagate

IDEAL = {"amplifier": {"bandwidth_hz": 0, "dac_bits": 0}}
J, B, C, KT = 6.28e-6, 9.0e-6, 2.0e-3, 0.0292


def plant(position: float = 0.0, velocity: float = 0.0) -> Plant:
    return Plant.from_config(parse_config(IDEAL, "test"), position, velocity)


def test_the_documented_example() -> None:
    assert doctest.testmod(device) == (0, 6)


def test_commands_and_steps_in_seconds() -> None:
    motor = plant(0.2, 1.0)
    motor.command(0.5, time=0.0)
    motor.advance(0.003)
    x, v = propagate(0.2, 1.0, 0.003, 0.5 * KT, J, B, C)
    assert (motor.position, motor.velocity, motor.current, motor.time) == (x, v, 0.5, 0.003)
    assert motor.counts == math.floor(x / (2 * math.pi / 8192))
    assert motor.buffer[kernel.POSITION] == x


def test_a_command_ahead_of_time_moves_on_to_it() -> None:
    motor = plant(0.2, 1.0)
    motor.command(0.5, time=0.004)
    motor.advance(0.005)
    x, v = propagate(0.2, 1.0, 0.004, 0.0, J, B, C)
    assert (motor.position, motor.velocity) == propagate(x, v, 0.001, 0.5 * KT, J, B, C)


@pytest.mark.parametrize("step", [0.05, 0.0037])
def test_a_hand_schedule_is_honoured_whatever_the_step(step: float) -> None:
    motor = plant()
    motor.hand_force = 0.003
    motor.schedule_hand_force([0.0101, 0.02, 0.0333], [-0.004, 0.0, 0.0025])
    time = 0.0
    while time < 0.05:
        time = min(time + step, 0.05)
        motor.advance(time)
    x, v = 0.0, 0.0
    for dt, force in [(0.0101, 0.003), (0.0099, -0.004), (0.0133, 0.0), (0.0167, 0.0025)]:
        x, v = propagate(x, v, dt, force, J, B, C)
    assert motor.position == pytest.approx(x, rel=1e-11)
    assert motor.velocity == pytest.approx(v, rel=1e-11)
    assert motor.hand_force == 0.0025


def test_a_command_does_not_jump_over_the_hand() -> None:
    motor = plant()
    motor.schedule_hand_force([0.0, 0.002], [0.003, -0.003])
    motor.command(0.0, time=0.004)
    x, v = propagate(0.0, 0.0, 0.002, 0.003, J, B, C)
    x, v = propagate(x, v, 0.002, -0.003, J, B, C)
    assert motor.position == pytest.approx(x, rel=1e-14)


@pytest.mark.parametrize(
    ("times", "forces", "message"),
    [
        ([0.1, 0.2], [1.0], "2 times for 1 forces"),
        ([0.1, 0.1], [1.0, 2.0], "the times of a hand force schedule must rise"),
        ([0.0005], [1.0], "the schedule begins at 0.0005 s, before the present 0.001 s"),
        ([math.nan], [1.0], "time nan s is not finite"),
    ],
)
def test_wrong_schedules_are_refused(times: list[float], forces: list[float], message: str) -> None:
    motor = plant()
    motor.advance(0.001)
    with pytest.raises(ValueError, match=f"^{message}$"):
        motor.schedule_hand_force(times, forces)


@pytest.mark.parametrize("time", [math.inf, -math.inf, math.nan])
def test_times_are_finite(time: float) -> None:
    with pytest.raises(ValueError, match="is not finite"):
        plant().advance(time)


def test_more_commands_than_the_delay_can_hold_are_refused_aloud() -> None:
    motor = Plant.from_config(parse_config({"amplifier": {"bandwidth_hz": 0.1}}, "test"))
    for _ in range(kernel.QUEUE_LENGTH):
        motor.command(1.0, time=0.0)
    with pytest.raises(OverflowError, match="4096 commands are already waiting"):
        motor.command(1.0, time=0.0)


@pytest.mark.parametrize(
    ("seconds", "instant"),
    [
        (0.0, (0, 0.0)),
        (0.001, (1_000_000, 0.0)),
        (3.0, (3_000_000_000, 0.0)),
        (1e6 + 0.5, (1_000_000_500_000_000, 0.0)),
        (-0.25, (-250_000_000, 0.0)),
        (2.5e-10, (0, 0.25)),
    ],
)
def test_seconds_become_instants(seconds: float, instant: tuple[int, float]) -> None:
    assert split_time(seconds) == instant
