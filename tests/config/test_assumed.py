"""What a config does not say of its own device is assumed, and told."""

from __future__ import annotations

from typing import Any

import pytest

import hapticd
from hapticd.config import apply_settings, load_config, parse_config
from hapticd.config.assumed import assumed, assumed_text

PLANT = ("plant.inertia", "plant.viscous", "plant.coulomb")
SAID = {"plant": {"inertia": 1e-5, "viscous": 1e-5, "coulomb": 1e-3}, "amplifier": {"torque_constant": 0.03}}


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        ({}, ()),
        ({"spring": {"stiffness": 0.02}}, ()),
        ({"plant": {"inertia": 6e-5}}, ("plant.viscous", "plant.coulomb")),
        ({"driver": {"name": "canopen"}}, ("amplifier.torque_constant", *PLANT)),
        ({"driver": {"name": "canopen"}, **SAID}, ()),
        ({"driver": {"name": "serial_dac"}, "plant": {"coulomb": 0.0}}, ("amplifier.torque_constant", *PLANT[:2])),
    ],
)
def test_what_is_assumed(data: dict[str, Any], keys: tuple[str, ...]) -> None:
    config = parse_config(data, "test")
    assert assumed(config) == keys
    assert assumed(apply_settings(config, {"spring.stiffness": 0.01})) == keys
    assert (assumed_text(config) == "") == (keys == ())


def test_presets_say_all_of_it() -> None:
    for name in ("re35", "omega", "delta", "phantom"):
        assert assumed(load_config(name)) == ()


def test_check_lists_it_and_calls_nothing_proven() -> None:
    found = hapticd.check({"plant": {"inertia": 6.3e-6}})
    assert found.document["assumed"] == ["plant.viscous", "plant.coulomb"]
    assert found.document["proven"] is False
    assert "assumed, for the config does not say it: plant.viscous = " in found.warnings[-1]
    sure = hapticd.check({"plant": {"inertia": 6.3e-6, "viscous": 9e-6, "coulomb": 2e-3}})
    assert "assumed" not in sure.document
    assert sure.document["proven"] is True
