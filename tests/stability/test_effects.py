"""Effects of a plant in the theory: counted where the numbers can hold them, named where they cannot."""

from __future__ import annotations

from math import pi
from typing import Any

import pytest

from hapticd.config import Config, parse_config
from hapticd.stability.assessment import assess
from hapticd.stability.cautions import uncounted
from hapticd.stability.numbers import loop_from_config

BASE = loop_from_config(parse_config({}, "x"))


def device(*effects: dict[str, Any]) -> Config:
    return parse_config({"plant": {"effects": list(effects)}}, "x")


@pytest.mark.parametrize(
    ("effect", "attribute", "expected"),
    [
        ({"name": "inertia_error", "r": 0.5}, "inertia", 1.5 * BASE.inertia),
        ({"name": "viscous_friction", "r": -0.5}, "viscous", 0.5 * BASE.viscous),
        ({"name": "coulomb_friction", "r": 1.0}, "coulomb", 2.0 * BASE.coulomb),
        ({"name": "torque_constant_error", "r": 0.2}, "stiffness", 1.2 * BASE.stiffness),
        ({"name": "asymmetric_coulomb", "a": -0.3}, "coulomb", 0.7 * BASE.coulomb),
        ({"name": "asymmetric_viscous", "a": 0.3}, "viscous", 0.7 * BASE.viscous),
        ({"name": "thermal_drift", "r": -0.4, "t_w": 5.0}, "coulomb", 0.6 * BASE.coulomb),
        ({"name": "thermal_drift", "r": 0.4, "t_w": 5.0}, "coulomb", BASE.coulomb),
        ({"name": "transport_delay", "t_d": 0.002}, "delay", BASE.delay + 0.002),
        ({"name": "amplifier_lag", "f_a": 100.0, "delta": 0.7}, "delay", BASE.delay + 2 * 0.7 / (2 * pi * 100.0)),
        ({"name": "return_spring", "k_s": 0.004}, "hand_stiffness", 0.004),
    ],
)
def test_what_an_effect_does_to_the_loop(effect: dict[str, Any], attribute: str, expected: float) -> None:
    loop = loop_from_config(device(effect))
    assert getattr(loop, attribute) == pytest.approx(expected, rel=1e-12)
    changed = {name for name in vars(BASE) if getattr(loop, name) != getattr(BASE, name)}
    # a stronger motor makes the converter's steps larger too
    assert changed <= ({attribute, "force_error"} if attribute == "stiffness" else {attribute})


def test_a_delay_that_was_found_makes_the_loop_worse() -> None:
    before = assess(device(), deflection=20)
    after = assess(device({"name": "transport_delay", "t_d": 0.001}), deflection=20)
    assert after.numbers.tau_d == pytest.approx(before.numbers.tau_d + 1.0)


def test_what_is_left_out_is_named() -> None:
    config = device({"name": "backlash", "gap": 1e-3}, {"name": "transport_delay", "t_d": 1e-3})
    assert uncounted(config) == ("backlash",)
    (warning,) = [text for text in assess(config).warnings if "plant.effects" in text]
    assert "backlash" in warning
    assert "transport_delay" not in warning
