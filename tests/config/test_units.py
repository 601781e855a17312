"""Quantities with units: against the sizes of the units, for both kinds of device."""

from __future__ import annotations

import math

import pytest

from hapticd.config import Config, load_config, parse_config
from hapticd.config.units import UnitError, amplitude, deflection_ticks, seconds, split, velocity_ticks

ROTARY = parse_config({"encoder": {"counts_per_rev": 8192, "decimation": 217}, "servo": {"rate_hz": 500}}, "rotary")
LINEAR = parse_config({"encoder": {"counts_per_metre": 1e5, "decimation": 10}}, "linear")
TICK = 217 * 2 * math.pi / 8192


@pytest.mark.parametrize(
    ("asked", "config", "ticks"),
    [
        (20.3, ROTARY, 20.3),
        ("20.3", ROTARY, 20.3),
        ("10.3ticks", ROTARY, 10.3),
        ("1 tick", ROTARY, 1.0),
        ("-217counts", ROTARY, -1.0),
        ("0.5rad", ROTARY, 0.5 / TICK),
        ("30deg", ROTARY, math.pi / 6 / TICK),
        ("30°", ROTARY, math.pi / 6 / TICK),
        ("1e-1rev", ROTARY, 0.2 * math.pi / TICK),
        ("2mm", LINEAR, 20.0),
        ("-0.5 in", LINEAR, -127.0),
        ("7µm", LINEAR, 0.07),
    ],
)
def test_deflections(asked: float | str, config: Config, ticks: float) -> None:
    assert deflection_ticks(asked, config) == pytest.approx(ticks, rel=1e-12)


@pytest.mark.parametrize(
    ("asked", "config", "ticks_per_period"),
    [
        ("5", ROTARY, 5.0),
        ("5ticks/period", ROTARY, 5.0),
        ("100 ticks/s", ROTARY, 0.2),
        ("2rad/s", ROTARY, 2 / TICK / 500),
        ("60rpm", ROTARY, 2 * math.pi / TICK / 500),
        ("1 rev / s", ROTARY, 2 * math.pi / TICK / 500),
        ("50mm/s", LINEAR, 0.5),
    ],
)
def test_velocities(asked: str, config: Config, ticks_per_period: float) -> None:
    assert velocity_ticks(asked, config) == pytest.approx(ticks_per_period, rel=1e-12)


def test_durations_and_amplitudes() -> None:
    assert [seconds(text) for text in ("2", "500ms", "2min", "1h")] == [2.0, 0.5, 120.0, 3600.0]
    assert amplitude("200mA", ROTARY, moves_origin=False) == pytest.approx(0.2)
    assert amplitude("30deg", ROTARY, moves_origin=True) == pytest.approx(math.pi / 6)
    assert amplitude("0.3", ROTARY, moves_origin=False) == 0.3


def test_a_number_with_unit_is_that_number_exactly() -> None:
    assert split("10.3ticks") == (10.3, "ticks")
    assert deflection_ticks("10.3ticks", load_config(None)) == 10.3


@pytest.mark.parametrize(
    ("asked", "config", "said"),
    [
        ("2mm", ROTARY, "'2mm': the device is rotary; give angles in rad, mrad, deg"),
        ("30deg", LINEAR, "'30deg': the device is linear; give lengths in m, cm, mm"),
        ("3tikcs", ROTARY, "'3tikcs': unknown unit 'tikcs'; did you mean ticks?"),
        ("0,5rad", ROTARY, "the decimal sign is a point: 0.5rad"),
        ("rad", ROTARY, "'rad' is not a number"),
        ("", ROTARY, "'' is not a number"),
        ("1e999rad", ROTARY, "is not a finite number"),
        ("nan", ROTARY, "is not a"),
        ("2A", ROTARY, "unknown unit 'A'"),
    ],
)
def test_what_is_no_deflection_says_what_would_be(asked: str, config: Config, said: str) -> None:
    with pytest.raises(UnitError) as error:
        deflection_ticks(asked, config)
    assert said in str(error.value)


@pytest.mark.parametrize("asked", ["2rad", "2ticks", "2rad/week", "2/s"])
def test_a_velocity_is_a_place_per_time(asked: str) -> None:
    with pytest.raises(UnitError):
        velocity_ticks(asked, ROTARY)


def test_a_current_is_no_place() -> None:
    with pytest.raises(UnitError, match="unknown unit 'deg'"):
        amplitude("3deg", ROTARY, moves_origin=False)
    with pytest.raises(UnitError, match="unknown unit 'mA'"):
        amplitude("3mA", ROTARY, moves_origin=True)
