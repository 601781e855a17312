"""`init`: answers with data-sheet units become a config that checks; what cannot be meant is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hapticd.config import ConfigError, load_config
from hapticd.config.assumed import assumed
from hapticd.identify.questions import QUESTIONS, answered, config_text, doubt_about

from ..cli.conftest import Run, hapticd

__all__ = ["hapticd"]


def test_no_answer_is_the_testbed() -> None:
    _, config, doubts = config_text(answered({}, "none"))
    testbed = load_config(None)
    assert (config.plant, config.amplifier, config.encoder) == (testbed.plant, testbed.amplifier, testbed.encoder)
    assert doubts == []


def test_units_of_data_sheets() -> None:
    said = {
        "inertia": "62.8 g cm²",
        "torque_constant": "30.2 mN m/A",
        "counts_per_rev": "2048 lines",
        "max_speed": "3000 rpm",
        "max_excursion": "180 deg",
        "dac_bits": "12",
    }
    _, config, _ = config_text(answered(said, "sheet"))
    assert config.plant.inertia == pytest.approx(6.28e-6)
    assert config.amplifier.torque_constant == pytest.approx(0.0302)
    assert config.encoder.counts_per_rev == 8192.0
    assert config.safety.max_velocity == pytest.approx(314.159, rel=1e-5)
    assert config.safety.max_excursion == pytest.approx(3.14159, rel=1e-5)
    assert config.amplifier.dac_bits == 12


def test_a_linear_device_is_asked_its_own_questions() -> None:
    answers = answered({"device": "linear", "mass": "72 g", "counts_per_metre": "40 counts/mm"}, "slide")
    _, config, _ = config_text(answers)
    assert config.is_linear
    assert config.plant.inertia == pytest.approx(0.072)
    assert "torque_constant" not in answers


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"torque_constnat": 1.0}, "did you mean torque_constant?"),
        ({"inertia": "6 stone"}, "= \"6 stone\": unknown unit 'stone'; give it in kg m²; known: kg m², g cm²"),
        ({"inertia": "much"}, "= much: is not a number; known: kg m², g cm²"),
        ({"device": "round"}, "must be one of rotary, linear"),
        ({"mass": 1.0}, "is for a linear device, and device is rotary"),
        ({"dac_bits": 12.5}, "must be a whole number"),
        ({"rate": True}, "must be a number in Hz"),
    ],
)
def test_wrong_answers_are_named(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match="answers") as error:
        answered(given, "answers")
    assert said in str(error.value)


def test_an_implausible_answer_is_doubted_at_once() -> None:
    question = next(question for question in QUESTIONS if question.key == "inertia")
    assert "62.8 g cm² is 6.28e-06 kg m²" in doubt_about(question, 62.8)
    assert doubt_about(question, 6.28e-6) == ""


def test_the_command_writes_a_config_that_checks(hapticd: Run, tmp_path: Path) -> None:
    answers, rig = tmp_path / "answers.yaml", tmp_path / "rig.yaml"
    answers.write_text("inertia: 65 g cm^2\nfriction_torque: 2.1 mN m\n")
    outcome = hapticd("init", str(rig), "--answers", str(answers), "--json")
    assert outcome.code == 0
    assert outcome.document["warnings"] == []
    assert load_config(rig).plant.coulomb == pytest.approx(2.1e-3)
    assert "region" in hapticd("check", str(rig), "--json").document
    assert hapticd("init", str(rig), "--answers", str(answers)).code == 2
    answers.write_text("inertia: 62.8\n")
    outcome = hapticd("init", str(rig), "--answers", str(answers), "--force")
    assert "62.8 g cm² is 6.28e-06 kg m²" in outcome.err


def test_with_nobody_to_ask_it_says_so(hapticd: Run, tmp_path: Path) -> None:
    outcome = hapticd("init", str(tmp_path / "rig.yaml"))
    assert outcome.code == 2
    assert "--answers FILE" in outcome.err
    assert not (tmp_path / "rig.yaml").exists()


def test_a_plant_that_nobody_said_is_left_to_be_measured(hapticd: Run, tmp_path: Path) -> None:
    answers, rig = tmp_path / "answers.yaml", tmp_path / "rig.yaml"
    answers.write_text("device: linear\ndriver: serial_dac\nport: /dev/serial/by-id/board\nmass: 60 g\n")
    outcome = hapticd("init", str(rig), "--answers", str(answers), "--json")
    assert (outcome.code, outcome.document["warnings"]) == (0, [])
    config = load_config(rig)
    assert config.driver.options == {"port": "/dev/serial/by-id/board"}
    assert assumed(config) == ("plant.viscous",)
    answers.write_text("port: /dev/ttyUSB0\n")
    refused = hapticd("init", str(rig), "--answers", str(answers), "--force")
    assert "port: is for driver serial_dac, and driver is loopback" in refused.err.replace(" = /dev/ttyUSB0", "")
