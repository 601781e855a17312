"""Limits that are none are named, however that was written."""

from __future__ import annotations

import pytest

from hapticd.api.theory import check
from hapticd.config import parse_config
from hapticd.config.limits import limits_off

KEYS = (
    "servo.overrun.fault_after",
    "amplifier.continuous_current",
    "amplifier.peak_current",
    "safety.max_velocity",
    "safety.max_excursion",
    "safety.encoder_jump",
    "safety.missed_exchanges",
)


def test_the_defaults_switch_none_off() -> None:
    assert limits_off(parse_config({}, "test")) == []
    assert limits_off(parse_config({"encoder": {"counts_per_metre": 1e5}}, "test")) == []


@pytest.mark.parametrize("written", [0, -0.0, None])
@pytest.mark.parametrize("key", KEYS)
def test_each_limit_that_is_none_is_named(key: str, written: float | None) -> None:
    section, *inner, name = key.split(".")
    value = {name: written} if not inner else {inner[0]: {name: written}}
    assert limits_off(parse_config({section: value}, "test")) == [key]


def test_what_is_ideal_at_zero_is_no_limit() -> None:
    ideal = {"bandwidth_hz": 0, "dac_bits": 0, "dac_full_scale": 0}
    assert limits_off(parse_config({"amplifier": ideal}, "test")) == []


def test_check_warns_of_them() -> None:
    warnings = check({"safety": {"max_velocity": -0.0}}).warnings
    assert warnings[-1] == "limits that are off, since 0 and null mean none: safety.max_velocity"
    assert not any("limits" in text for text in check({}).warnings)
