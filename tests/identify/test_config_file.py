"""What is written into a config: the plant alone, with its comments kept, and valid."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.config import parse_yaml
from hapticd.config.assumed import assumed
from hapticd.config.editing import text_of
from hapticd.gap.result import Estimate
from hapticd.identify.config_file import with_plant
from hapticd.identify.result import Identified

RIG = """# my rig
servo: {rate_hz: 500}   # the bus does no more
plant:
  # guessed from the drawing
  inertia: 1.0e-6
  effects:
    - {name: stribeck, s: 0.5, omega_s: 3.0}  # grease
    - {name: constant_bias, tau_0: 1.0e-3}
"""


def identified(sign: int = 1, delay_s: float = 9e-4) -> Identified:
    def about(value: float, unit: str) -> Estimate:
        return Estimate(value, (0.9 * value, 1.1 * value), unit)

    return Identified(
        about(6e-6, "kg m²"),
        about(9e-6, "N m s/rad"),
        about(2e-3, "N m"),
        Estimate(1e-4, (-1e-4, 3e-4), "N m"),
        about(delay_s, "s"),
        sign,
        np.array([3e-7, 4.5e-7, 1e-4, 4.5e-5]),
        np.eye(4),
        0.0292,
        7.4e-5,
        False,
        ("a.arrow", "b.csv"),
        assumed=("the torque constant",),
    )


def test_comments_and_other_sections_stay() -> None:
    text = with_plant(RIG, identified())
    for kept in ("# my rig", "# the bus does no more", "# guessed from the drawing", "# grease"):
        assert kept in text
    config = parse_yaml(text, "written")
    assert config.servo.rate_hz == 500.0
    assert config.plant.inertia == 6e-6
    assert config.plant.uncertainty.delay_s == 4.5e-5
    assert "identified from a.arrow, b.csv" in text
    assert "assumed: the torque constant" in text


def test_effects_that_the_fit_replaces_go_and_others_stay() -> None:
    config = parse_yaml(with_plant(RIG, identified()), "written")
    assert [effect.name for effect in config.plant.effects] == ["stribeck", "transport_delay"]
    assert config.plant.effects[1].model_extra == {"t_d": pytest.approx(9e-4 - 7.4e-5)}


def test_a_delay_within_its_interval_of_the_declared_one_is_no_effect() -> None:
    config = parse_yaml(with_plant("{}", identified(delay_s=7.5e-5)), "written")
    assert config.plant.effects == ()


def test_the_sign_is_put_right() -> None:
    assert parse_yaml(with_plant("{}", identified(sign=-1)), "written").encoder.invert
    inverted = with_plant("encoder: {invert: true}\n", identified(sign=-1))
    assert not parse_yaml(inverted, "written").encoder.invert


def test_writing_twice_says_nothing_twice() -> None:
    once = with_plant(RIG, identified())
    twice = with_plant(once, identified())
    assert twice.count("identified from") == 1
    assert parse_yaml(once, "once") == parse_yaml(twice, "twice")


def test_what_was_assumed_is_said_then() -> None:
    text = "driver: {name: canopen}\namplifier: {torque_constant: 0.03}\n"
    assert assumed(parse_yaml(text, "before")) == ("plant.inertia", "plant.viscous", "plant.coulomb")
    assert assumed(parse_yaml(with_plant(text, identified()), "written")) == ()


def test_a_plant_on_one_line_becomes_a_block() -> None:
    config = parse_yaml(with_plant("plant: {inertia: 1.0e-6}  # mine\n", identified()), "written")
    assert config.plant.coulomb == 2e-3


def test_a_preset_is_a_text_too() -> None:
    config = parse_yaml("{}", "default")
    assert "counts_per" in with_plant(text_of("phantom", config), identified())
    assert parse_yaml(with_plant(text_of(None, config), identified()), "all keys").plant.inertia == 6e-6
