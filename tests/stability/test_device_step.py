"""The step of the command that a device takes is an error of the force, as a converter's is."""

from __future__ import annotations

import pytest

from drivers import declared_step
from hapticd.config import parse_config
from hapticd.stability.numbers import loop_from_config

AMPLIFIER = {"torque_constant": 0.0292, "continuous_current": 2.0, "peak_current": 6.0, "dac_bits": 0}


@pytest.mark.parametrize(
    ("options", "step"),
    [
        ({"profile": "cia402", "rated_torque": 0.0584, "rated_current": 2.0}, 2e-3),
        ({"profile": "cia402"}, 10e-3),  # what bring-up lets through at 2 A: up to 10 A rated
        ({"profile": "copley", "rated_torque": 0.0584, "rated_current": 2.0}, 10e-3),  # programmed current: 0.01 A
    ],
)
def test_the_step_of_a_drive(options: dict[str, object], step: float) -> None:
    config = parse_config({"driver": {"name": "canopen", **options}, "amplifier": AMPLIFIER}, "test")
    assert declared_step(config) == pytest.approx(step)
    assert loop_from_config(config).force_error == pytest.approx(0.5 * step * 0.0292)


def test_no_device_no_step() -> None:
    assert loop_from_config(parse_config({"amplifier": AMPLIFIER}, "test")).force_error == 0.0
