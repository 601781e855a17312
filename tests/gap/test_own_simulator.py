"""A function as the nominal model: what it says is not found again, and what it lacks is."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import hapticd
from hapticd.cli.main import main
from hapticd.config import Config, parse_config
from hapticd.export.axis_numbers import axis_numbers
from hapticd.export.plain.axis import Axis
from hapticd.gap.own_simulator import find_torque

PERIOD_S, CUBIC = 1e-3, 3e-5
BASE = {"inertia": 6.28e-6, "viscous": 9e-6, "coulomb": 2e-3}
HIDDEN = {"name": "stribeck", "s": 0.6, "omega_s": 4.0}
SIMULATOR = """
import math

K_T, CUBIC = 0.0292, 3e-5


def torque(x, v, i, t):
    friction = 9e-6 * v + (math.copysign(2e-3, v) if v else 0.0)
    return K_T * i - friction - CUBIC * x**3


def broken(x, v, i, t):
    return 1.0 / 0.0
"""


def config(*effects: dict[str, object]) -> Config:
    plant = {**BASE, "effects": list(effects)}
    return parse_config({"plant": plant, "amplifier": {"bandwidth_hz": 0, "dac_bits": 0}}, "model")


class Device(Axis):
    """A shaft on a cubic spring, which the catalogue has not."""

    def pull(self, position: float, velocity: float, current: float, time: float) -> float:
        return super().pull(position, velocity, current, time) - CUBIC * position**3


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    device, rows = Device(axis_numbers(config(HIDDEN))), []
    for k in range(8000):
        t = k * PERIOD_S
        waves = ((0.09, 0.7, 0.0), (0.06, 1.9, 1.0), (0.06, 4.3, 2.0))
        command = sum(size * math.sin(2 * math.pi * f * t + phase) for size, f, phase in waves)
        rows.append((t, device.counts, command))
        device.step(command, PERIOD_S)
    path = tmp_path_factory.mktemp("own") / "run.csv"
    np.savetxt(path, rows, "%.6f,%d,%.9f", header="time_s,encoder_counts,current_command_A", comments="")
    return path


@pytest.fixture
def simulator(tmp_path: Path) -> Path:
    path = tmp_path / "lab_simulator.py"
    path.write_text(SIMULATOR)
    return path


CANDIDATES = ["stribeck", "return_spring", "gravity", "quadratic_drag", "constant_bias"]


def test_the_effect_is_added_to_the_simulator(run: Path, simulator: Path) -> None:
    torque = find_torque(f"{simulator}:torque")
    result = hapticd.find_gap(run, config(), effects=CANDIDATES, nominal=torque, validate=None)
    (step,) = result.steps
    assert step.effect == "stribeck"
    assert step.parameters["s"].value == pytest.approx(0.6, rel=0.1)
    assert result.gap.held_out_after < 0.1 * result.gap.held_out_before
    # without it the spring is looked for among the laws that are known, and is not there
    without = hapticd.find_gap(run, config(), effects=CANDIDATES)
    assert [one.effect for one in without.steps] != ["stribeck"]
    assert without.gap.held_out_after > 3.0 * result.gap.held_out_after


def test_the_command_says_what_it_was_added_to(
    run: Path, simulator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "rig.yaml"
    model.write_text(
        "plant: {inertia: 6.28e-6, viscous: 9e-6, coulomb: 2e-3}\namplifier: {bandwidth_hz: 0, dac_bits: 0}\n"
    )
    words = ["gap", str(run), "--model", str(model), "--effect", "stribeck", "-o", str(tmp_path / "gap")]
    assert main([*words, "--nominal", f"{simulator}:torque", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["nominal"] == f"{simulator}:torque"
    assert document["effects"] == ["stribeck"]
    assert main([*words, "--nominal", f"{simulator}:broken"]) == 2
    assert "ZeroDivisionError" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("nothing", "write module:function"),
        ("no_such_module_of_mine:torque", "cannot be imported"),
        ("no/such/file.py:torque", "no such file"),
        ("math:torque", "has no function"),
        ("math:pi", "has no function"),
    ],
)
def test_what_names_no_function_is_refused(name: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        find_torque(name)
