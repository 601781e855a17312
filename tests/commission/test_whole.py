"""The steps with a daemon, in real time on the loopback; and the command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from benchmarks.commission import BENCH, rig_of
from hapticd.commission import run
from hapticd.commission.rig import Given
from hapticd.commission.steps import NAMES
from hapticd.config import parse_config
from tests.cli.conftest import Run, hapticd

__all__ = ["hapticd"]


@pytest.mark.realtime
@pytest.mark.usefixtures("forked")
def test_a_known_inertia_shows_a_wrong_torque_constant(tmp_path: Path) -> None:
    right = parse_config({}, "RE35")
    believed = parse_config(
        {"amplifier": {"torque_constant": 0.0292 * 1.33}, "plant": {"inertia": 6.28e-6}}, "believed"
    )
    with rig_of(believed, right, {}, tmp_path, virtual=True) as rig:
        rig.given = Given(inertia=6.28e-6)
        results = run.commission(rig, only=[*BENCH, "estop", "trips", "identify", "stiffness"])
    if disturbed := [result.finding for result in results.values() if result.result == "disturbed"]:
        pytest.skip(disturbed[0])
    found = {name: result.finding for name, result in results.items() if result.result == "fail"}
    assert list(found) == ["identify"], found
    assert results["estop"].figures["fault"] == "estop"
    assert results["trips"].figures["over_speed_fault"] == "over_speed"
    assert results["trips"].figures["excursion_fault"] == "excursion"
    assert results["identify"].figures["torque_constant_implied"] == pytest.approx(0.0292, rel=0.03)
    assert "it needs identify, which failed" in results["stiffness"].finding
    assert "no known weight" in results["torque_constant"].finding


def test_the_command_leaves_a_certificate_and_a_page(hapticd: Run, tmp_path: Path) -> None:
    config, out = tmp_path / "rig.yaml", tmp_path / "day"
    config.write_text(yaml.safe_dump({"amplifier": {"continuous_current": None}}))
    outcome = hapticd("commission", str(config), "-o", str(out), "--yes", "--json")
    assert outcome.code == 1
    document = outcome.document
    assert document["failed"] == ["doctor"]
    assert not document["passed"]
    assert [step["name"] for step in document["steps"]] == list(NAMES)
    assert all({"name", "result", "figures", "limit", "skipped"} <= step.keys() for step in document["steps"])
    assert "amplifier.continuous_current" in document["steps"][0]["finding"]
    assert json.loads((out / "commission.json").read_text())["config_digest"] == document["config_digest"]
    assert "is not fit to be used yet" in Path(document["page"]).read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--only", "singe"], "singe: no such step (known: doctor, "),
        (["--weight", "0.1"], "--weight goes with --arm on a rotary device"),
        (["--arm", "0.1"], "--arm goes with --weight"),
        (["--weight", "0.1", "--arm", "0.02", "--torque", "0.1"], "and not with --torque"),
    ],
)
def test_what_cannot_be_meant(words: list[str], message: str, hapticd: Run, tmp_path: Path) -> None:
    outcome = hapticd("commission", "re35", "-o", str(tmp_path / "day"), "--yes", *words)
    assert outcome.code == 2
    assert message in outcome.err


def test_results_of_another_config_are_replaced_with_force_alone(hapticd: Run, tmp_path: Path) -> None:
    config, out = tmp_path / "rig.yaml", tmp_path / "day"
    words = ["commission", str(config), "-o", str(out), "--yes", "--json", "--only", "doctor"]
    config.write_text(yaml.safe_dump({"amplifier": {"continuous_current": None}}))
    first = hapticd(*words).document
    config.write_text(yaml.safe_dump({"amplifier": {"continuous_current": None}, "plant": {"coulomb": 1e-3}}))
    outcome = hapticd(*words)
    assert outcome.code == 2
    assert "state.json exists; give another name, or --force to replace it" in outcome.err
    digest = json.loads((out / "commission.json").read_text())["config_digest"]
    assert digest == first["config_digest"]
    assert hapticd(*words, "--force").document["config_digest"] != digest


def test_nobody_is_asked_without_a_terminal(hapticd: Run, tmp_path: Path) -> None:
    outcome = hapticd("commission", "re35", "-o", str(tmp_path / "day"))
    assert outcome.code == 2
    assert "--yes if the rig may move without a question" in outcome.err
    assert not (tmp_path / "day").exists()
