"""Numbers that no device has are questioned, with the unit that was probably meant."""

from __future__ import annotations

from typing import Any

import pytest

from hapticd.config import load_config, parse_config, preset_names
from hapticd.identify.plausible import implausible


@pytest.mark.parametrize("preset", preset_names())
def test_real_devices_are_plausible(preset: str) -> None:
    assert implausible(load_config(preset)) == []


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"plant": {"inertia": 62.8}}, "62.8 g cm² is 6.28e-06 kg m²"),
        ({"plant": {"inertia": 6.28e-6, "viscous": 1e-1}}, "plant.inertia / plant.viscous = 6.28e-05 s"),
        ({"plant": {"coulomb": 2.0}}, "more than the motor's largest torque"),
        ({"amplifier": {"torque_constant": 29.2}}, "29.2 mN m is 0.0292 N m/A"),
        ({"encoder": {"counts_per_rev": 12}}, "encoder.counts_per_rev = 12"),
        ({"encoder": {"decimation": 2048}}, "a coarse tick is 1.57 rad"),
        ({"plant": {"inertia": 1e-9}}, "would accelerate"),
        ({"encoder": {"counts_per_metre": 100.0}}, "100 counts/mm is 1e+05 counts/m"),
    ],
)
def test_slips_are_named(data: dict[str, Any], said: str) -> None:
    assert any(said in words for words in implausible(parse_config(data, "slip"))), implausible(
        parse_config(data, "slip")
    )
