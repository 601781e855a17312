"""What a config does not say of its own device is assumed, and told."""

from __future__ import annotations

import operator
import re
from typing import Any

import pytest

import hapticd
from hapticd.config import apply_settings, load_config, parse_config
from hapticd.config.assumed import assumed, assumed_text
from hapticd.scope.theory import ends
from hapticd.stability.zwidth import zwidth

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
    assert "assumed, because the config does not give it: plant.viscous = " in found.warnings[-1]
    sure = hapticd.check({"plant": {"inertia": 6.3e-6, "viscous": 9e-6, "coulomb": 2e-3}})
    assert "assumed" not in sure.document
    assert sure.document["proven"] is True


OTHERS: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({"plant": {"inertia": 6.3e-6}}, {}),
    ({"plant": {"inertia": 6.3e-6}}, {"deflection": 10.3}),
    ({"driver": {"name": "canopen"}}, {}),
    ({"driver": {"name": "serial_dac"}, "spring": {"stiffness": 0.03}}, {"velocity": 0.5}),
    ({"driver": {"name": "serial_dac"}, "spring": {"stiffness": 0.5}}, {"deflection": 10.3}),
]


@pytest.mark.parametrize(("data", "motion"), OTHERS)
def test_no_word_of_proof_while_a_number_is_assumed(data: dict[str, Any], motion: dict[str, Any]) -> None:
    """What it says of the same numbers, said: what changes is the claim, not what is rendered."""
    config = parse_config(data, "test")
    found = hapticd.check(config, **motion)
    told = " ".join(f"{found} {found.guard.reason}".split()).replace("No theorem proves it", "")
    assert not re.search(r"\bprove[sn]\b", told)
    assert f"assumed {', '.join(assumed(config))}" in told
    assert (found.document["proven"], found.assessment.proven) == (False, False)
    numbers = {key: operator.attrgetter(key)(config) for key in assumed(config)}
    sure = hapticd.check(apply_settings(config, numbers), **motion)
    assert sure.assumed == ()
    assert (sure.verdict, sure.guard.verdict, sure.assessment.explored) == (
        found.verdict, found.guard.verdict, found.assessment.explored,
    )  # fmt: skip


IDEAL: dict[str, Any] = {"amplifier": {"bandwidth_hz": 0, "dac_bits": 0, "torque_constant": 0.03}}
OTHER: dict[str, Any] = {"inertia": 6.3e-6, "viscous": 0.1}


@pytest.mark.parametrize(("more", "some"), [({}, False), ({"coulomb": 0.02}, True)])
def test_a_z_width_proves_nothing_with_assumed_numbers(more: dict[str, float], some: bool) -> None:
    found = zwidth(parse_config({"plant": {**OTHER, **more}, **IDEAL}, "test"), 0.0, count=3, stiffness_max=30.0)
    assert bool(found.proven.any()) is some
    assert any(row["proven"] for row in found.report["rows"]) is some


def test_the_page_says_it() -> None:
    assert ends({"plant": OTHER, **IDEAL})["words"] == "rest 100 %, if what is assumed is true"
    assert ends({"plant": {**OTHER, "coulomb": 2e-3}, **IDEAL})["words"] == "rest 100 %, proven"
