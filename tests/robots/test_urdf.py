"""A URDF's limits, as hints for what was imported with them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hapticd.cli.main import main
from hapticd.record import RunFileError, import_run
from hapticd.record.importing_map import ImportMap, parse_map
from hapticd.robots import hold_against, limits_of

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <joint name="base" type="fixed"/>
  <joint name="elbow" type="revolute"><limit effort="{effort}" velocity="{velocity}" lower="-2" upper="2"/></joint>
  <joint name="wrist" type="continuous"/>
  <joint name="lift" type="prismatic"><limit effort="0" velocity="0.2"/></joint>
</robot>
"""
T = np.arange(500) * 0.002
Q = np.sin(2 * np.pi * T)
"""It moves at up to 6.28 rad/s."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rows = np.stack([T, Q, 12.0 * np.sign(np.cos(9 * T))], 1)
    np.savetxt("log.csv", rows, delimiter=",", header="t,elbow.position,tau", comments="")
    return tmp_path


def urdf(effort: str = "30", velocity: str = "10") -> None:
    Path("arm.urdf").write_text(URDF.format(effort=effort, velocity=velocity))


def mapping(**more: object) -> ImportMap:
    data = {
        "device": "rotary",
        "time": {"column": "t"},
        "position": {"column": "elbow.position", "resolution": 1e-4},
        "force": {"column": "tau"},
        "torque_constant": 0.5,
        "urdf": {"file": "arm.urdf"},
    }
    return parse_map({**data, **more}, "map.yaml")


@pytest.mark.parametrize(
    ("effort", "velocity", "said"),
    [
        ("30", "10", []),
        ("12", "10", ["arm.urdf limits elbow to 12 N m, and 500 rows are at it: the drive may have cut them"]),
        ("0.012", "10", ["arm.urdf limits elbow to 0.012 N m, and the command reaches 12: is its unit right"]),
        ("30", "0.1", ["arm.urdf limits elbow to 0.1 rad/s, and it moves at 6.2"]),
        ("0", "0", []),
        ("inf", "-1", []),
    ],
)
def test_limits_are_hints(folder: Path, effort: str, velocity: str, said: list[str]) -> None:
    urdf(effort, velocity)
    limits = limits_of(mapping())
    assert limits is not None
    done = hold_against(import_run("log.csv", mapping(), "run.arrow"), limits)
    assert len(done.warnings) == len(said)
    assert all(warning.startswith(words) for warning, words in zip(done.warnings, said, strict=True))
    right = {"amplifier.peak_current": 2.0 * float(effort), "safety.max_velocity": float(velocity)}
    assert done.hints == {key: pytest.approx(value) for key, value in right.items() if 0.0 < value < np.inf}


def test_the_command_tells_them(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf()
    Path("map.yaml").write_text(json.dumps(mapping().model_dump(mode="json", exclude_defaults=True)))
    assert main(["import", "log.csv", "--map", "map.yaml", "-o", "run.arrow"]) == 0
    assert "for a config, by the URDF: safety.max_velocity: 10" in capsys.readouterr().out
    assert main(["import", "log.csv", "--map", "map.yaml", "-o", "run.arrow", "--force", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["hints"] == {"amplifier.peak_current": 60.0, "safety.max_velocity": 10.0}


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"urdf": {"file": "arm.urdf", "joint": "elbo"}}, "no joint 'elbo' that moves; did you mean elbow"),
        ({"urdf": {"file": "arm.urdf", "joint": "base"}}, "urdf.joint is one of elbow, wrist, lift"),
        ({"urdf": {"file": "arm.urdf", "joint": "lift"}}, "joint lift is prismatic, but device = rotary"),
        ({"urdf": {"file": "none.urdf"}}, "not a readable URDF: No such file"),
        ({"urdf": {"file": "log.csv"}}, "not a readable URDF"),
        ({"urdf": {"file": "bomb.urdf"}}, "or entities"),
    ],
)
def test_what_is_no_such_joint_is_refused_before_anything_is_written(
    folder: Path, more: dict[str, object], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf()
    Path("bomb.urdf").write_text('<!DOCTYPE r [<!ENTITY a "aaaa">]><robot>&a;</robot>')
    with pytest.raises(RunFileError, match=why):
        limits_of(mapping(**more))
    Path("map.yaml").write_text(json.dumps(mapping(**more).model_dump(mode="json", exclude_defaults=True)))
    assert main(["import", "log.csv", "--map", "map.yaml", "-o", "run.arrow"]) != 0
    assert not Path("run.arrow").exists()


def test_a_limit_that_is_no_number_is_named(folder: Path) -> None:
    urdf(effort="much")
    with pytest.raises(RunFileError, match="joint elbow: <limit>: could not convert"):
        limits_of(mapping())
    assert limits_of(parse_map({**mapping().model_dump(exclude_defaults=True), "urdf": None}, "map.yaml")) is None
