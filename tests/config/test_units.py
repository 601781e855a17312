"""Quantities with units: against the sizes of the units, for both kinds of device."""

from __future__ import annotations

import math
from typing import Any

import pytest

from hapticd.config import Config, ConfigError, apply_settings, load_config, parse_config
from hapticd.config.units import UnitError, amplitude, deflection_ticks, in_unit, seconds, split, velocity_ticks

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


@pytest.mark.parametrize(
    ("asked", "unit", "config", "value"),
    [
        ("2.5", "ticks", ROTARY, 2.5),
        ("30deg", "ticks", ROTARY, math.pi / 6 / TICK),
        ("2 mm", "ticks", LINEAR, 20.0),
        ("2ticks", "counts", LINEAR, 20.0),
        ("500ms", "s", ROTARY, 0.5),
        ("15 mN m/rad", "N m/rad", ROTARY, 0.015),
        ("1 Nm/deg", "N m/rad", ROTARY, 180 / math.pi),
        ("3 N/mm", "N/m", LINEAR, 3000.0),
        ("2 deg/ms", "rad/s", ROTARY, 2 * math.pi / 180 * 1000),
        ("0.5kHz", "Hz", ROTARY, 500.0),
        ("20 %", "%", ROTARY, 20.0),
        ("0.1 N m s/rad", "N m s/rad", ROTARY, 0.1),
    ],
)
def test_any_unit(asked: str, unit: str, config: Config, value: float) -> None:
    assert in_unit(asked, unit, config) == pytest.approx(value, rel=1e-11)


def test_a_bare_number_is_in_the_unit_beside_it() -> None:
    assert in_unit("0.2", "s", ROTARY, bare="ms") == pytest.approx(2e-4)
    assert in_unit("0.2s", "s", ROTARY, bare="ms") == 0.2


@pytest.mark.parametrize("asked", ["2A", "2rad", "2 N m", "2 N/mm", "2 N m/rad/s", "", "2,5", "2 rad/rad"])
def test_what_is_of_another_kind_is_refused(asked: str) -> None:
    with pytest.raises(UnitError):
        in_unit(asked, "N m/rad", ROTARY)


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


@pytest.mark.parametrize(
    ("asked", "config", "said"),
    [
        ("0.3m/s", ROTARY, "the device is rotary; give speeds in rad/s, mrad/s, deg/s"),
        ("0.3m/s", ROTARY, "ticks/s, counts/s, rpm"),
        ("2deg/ms", LINEAR, "the device is linear; give speeds in m/ms, cm/ms"),
        ("2rda/s", ROTARY, "unknown unit 'rda'; did you mean rad/s? units here: rad/s, "),
    ],
)
def test_what_is_no_velocity_of_this_device_lists_units_of_speed(asked: str, config: Config, said: str) -> None:
    with pytest.raises(UnitError) as error:
        velocity_ticks(asked, config)
    assert said in str(error.value)
    assert "angle" not in str(error.value)
    assert "rad, " not in str(error.value)


def test_a_current_is_no_place() -> None:
    with pytest.raises(UnitError, match="unknown unit 'deg'"):
        amplitude("3deg", ROTARY, moves_origin=False)
    with pytest.raises(UnitError, match="unknown unit 'mA'"):
        amplitude("3mA", ROTARY, moves_origin=True)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("3Nm/rad", "N m/rad", 3.0),
        ("3 mN m/deg", "N m/rad", 0.003 * 180 / math.pi),
        ("60 g cm²", "kg m²", 6e-6),
        ("60gcm^2", "kg m²", 6e-6),
        ("8192 lines", "counts/rev", 32768.0),
        ("500 ppr", "counts/rev", 2000.0),
        ("3000 RPM", "rad/s", 100 * math.pi),
        ("10kHz", "Hz", 1e4),
        ("2 N/mm", "N/m", 2000.0),
        ("10 µN·m·s/rad", "N m s/rad", 1e-5),
        ("30 mNm/A", "N m/A", 0.03),
        ("0.3m/s", "m/s", 0.3),
        ("7", "N m/rad", 7.0),
    ],
)
def test_a_number_in_the_unit_of_its_place(text: str, unit: str, value: float) -> None:
    assert in_unit(text, unit) == pytest.approx(value, rel=1e-11)


@pytest.mark.parametrize(
    ("text", "unit", "said"),
    [
        ("3Nm", "N m/rad", "is another quantity; give it in N m/rad"),
        ("3 stone", "kg", "unknown unit 'stone'; give it in kg"),
        ("5 Hz", "rad/s", "is another quantity"),
        ("2024-01-01", "Hz", "is not a number"),
    ],
)
def test_a_unit_of_another_kind(text: str, unit: str, said: str) -> None:
    with pytest.raises(UnitError, match=said):
        in_unit(text, unit)


def test_units_in_config_files_settings_and_effects() -> None:
    config = parse_config(
        {
            "spring": {"stiffness": "12 mN m/rad", "origin": "30deg"},
            "servo": {"rate_hz": "2 kHz"},
            "encoder": {"counts_per_rev": "2048 lines"},
            "plant": {"inertia": "62.8 g cm²", "effects": [{"name": "stribeck", "s": 0.4, "omega_s": "100 rpm"}]},
            "dither": {"target": "current", "amplitude": "20 mA", "frequency_hz": 50},
        },
        "test",
    )
    assert config.spring.stiffness == pytest.approx(0.012)
    assert config.spring.origin == pytest.approx(math.pi / 6)
    assert config.servo.rate_hz == 2000.0
    assert config.encoder.counts_per_rev == 8192.0
    assert config.plant.inertia == pytest.approx(6.28e-6)
    assert config.plant.effects[0].model_extra == pytest.approx({"s": 0.4, "omega_s": 100 * 2 * math.pi / 60})
    assert config.dither.amplitude == pytest.approx(0.02)
    changed = apply_settings(config, {"spring.stiffness": "3Nm/rad", "safety.max_velocity": "500rpm"})
    assert (changed.spring.stiffness, changed.safety.max_velocity) == (3.0, pytest.approx(500 * 2 * math.pi / 60))
    linear = parse_config({"encoder": {"counts_per_metre": "1 counts/um"}, "spring": {"stiffness": "2 N/mm"}}, "test")
    assert (linear.encoder.counts_per_metre, linear.spring.stiffness) == (pytest.approx(1e6), 2000.0)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"spring": {"stiffness": "3 N/m"}}, 'spring.stiffness = "3 N/m": is another quantity; give it in N m/rad'),
        ({"servo": {"rate_hz": "1 kilo"}}, "servo.rate_hz = \"1 kilo\": unknown unit 'kilo'; give it in Hz"),
        ({"spring": {"stiffness": "5"}}, 'spring.stiffness = "5": must be a number in N m/rad; write 5 without quotes'),
        (
            {"plant": {"effects": [{"name": "stribeck", "s": 0.4, "omega_s": "3 N"}]}},
            'plant.effects[0].omega_s = "3 N": is another quantity; give it in rad/s',
        ),
        ({"servo": {"rate_hz": "-1 kHz"}}, "servo.rate_hz = -1000: must be"),
    ],
)
def test_a_wrong_unit_names_its_key_once(data: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_config(data, "test")
    assert [str(problem) for problem in caught.value.problems if said in str(problem)]
    assert len({problem.key for problem in caught.value.problems}) == len(caught.value.problems) == 1
