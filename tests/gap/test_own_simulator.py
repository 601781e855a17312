"""A function as the nominal model: what it says is not found again, and what it lacks is."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import hapticd
from hapticd.cli.main import main
from hapticd.config import Config, parse_config
from hapticd.export import write_model
from hapticd.export.axis_numbers import axis_numbers
from hapticd.export.plain.axis import Axis
from hapticd.gap.data import load_recording
from hapticd.gap.own_simulator import find_torque, with_simulator

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
    words = ["gap", str(run), "--model", str(model), "--effect", "stribeck", "--force", "-o", str(tmp_path / "gap")]
    assert main([*words, "--nominal", f"{simulator}:torque", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["nominal"] == f"{simulator}:torque"
    assert document["effects"] == ["stribeck"]
    assert main([*words, "--nominal", f"{simulator}:broken"]) == 2
    assert "ZeroDivisionError" in capsys.readouterr().err


OTHER_NAMES = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Lab(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.now, self.given = 0.0, {"shaft.phi": 0.0, "shaft.w": 0.0, "motor[1].i": 0.0}
        for name in self.given:
            self.register_variable(
                Real(name, causality=Fmi2Causality.input, getter=lambda n=name: self.given[n],
                     setter=lambda value, n=name: self.given.update({n: value}))
            )
        self.register_variable(Real("tau,sum", causality=Fmi2Causality.output, getter=self.torque))

    def torque(self):
        phi, w, i = self.given.values()
        if phi > 50.0:
            raise ValueError("out of its range")
        return 0.0292 * i - 9e-6 * w - 1e-4 * phi + 1e-3 * self.now

    def do_step(self, current_time, step_size):
        self.now = current_time + step_size
        return True
"""


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``rig.fmu``, which hapticd exports, and ``lab.fmu``, whose variables have names of their own."""
    pytest.importorskip("fmpy")
    builder = pytest.importorskip("pythonfmu").FmuBuilder
    folder = tmp_path_factory.mktemp("fmu")
    write_model(config(*LAWS), "fmu", folder / "rig.fmu")
    (folder / "lab.py").write_text(OTHER_NAMES)
    builder.build_FMU(folder / "lab.py", dest=folder / "lab.fmu")
    return folder


LAWS = ({"name": "gravity", "m_g_l": 3e-3, "theta_0": 0.4}, {"name": "thermal_drift", "r": 0.4, "t_w": 1.0})
ASKED = [
    (0.1, 2.0, 0.3, 0.0),
    (0.1, -2.0, 0.3, 0.0),
    (0.2, 1e-9, 0.01, 0.5),
    (3.0, 9.0, -1.0, 2.0),
    (0.0, 1.0, 0.0, 0.1),
]
NAMED = "lab.fmu:x=shaft.phi,v=shaft.w,i=motor[1].i,torque=tau,sum"


def test_an_fmu_of_our_own_is_the_model_it_was_exported_from(fmus: Path) -> None:
    torque, right = find_torque(str(fmus / "rig.fmu")), Axis(axis_numbers(config(*LAWS))).torque
    assert [torque(*each) for each in ASKED] == pytest.approx([right(*each) for each in ASKED], rel=1e-6)


def test_an_fmu_with_names_of_its_own(fmus: Path) -> None:
    torque = find_torque(str(fmus / NAMED))
    right = [0.0292 * i - 9e-6 * v - 1e-4 * x + 1e-3 * t for x, v, i, t in ASKED]
    assert [torque(*each) for each in ASKED] == pytest.approx(right, abs=1e-9)
    with pytest.raises(ValueError, match=r"^lab\.fmu: .*fmi2GetReal"):
        torque(51.0, 0.0, 0.0, 3.0)


def test_the_same_law_as_a_function_and_as_an_fmu_knows_the_same(run: Path, fmus: Path) -> None:
    recording = load_recording(run, config())
    of_fmu = with_simulator(recording, config(), find_torque(str(fmus / "rig.fmu"))).added
    of_function = with_simulator(recording, config(), Axis(axis_numbers(config(*LAWS))).torque).added
    assert np.ptp(of_function) > 0.05
    assert of_fmu == pytest.approx(of_function, abs=1e-6)


def test_the_command_takes_an_fmu(run: Path, fmus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["--effect", "stribeck", "--force", "-o", str(tmp_path / "gap")]
    words = ["gap", str(run), "--model", "re35", *out, "--nominal"]
    assert main([*words, str(fmus / "lab.fmu")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "has no input 'x'; its inputs: shaft.phi, shaft.w, motor[1].i; its outputs: tau,sum; name those" in said
    assert main([*words, str(fmus / "rig.fmu"), "--json"]) in (0, 1)
    assert json.loads(capsys.readouterr().out)["nominal"] == str(fmus / "rig.fmu")


def test_fmpy_is_named_where_it_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(ValueError, match=r"pip install 'hapticd\[export\]'"):
        find_torque("rig.fmu")


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("no/such.fmu", "no such file"),
        ("text.fmu", "not a readable FMU"),
        ("text.fmu:phi=x", "is not a list of variables"),
    ],
)
def test_what_is_no_fmu_is_refused(name: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fmpy")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.fmu").write_text("no FMU")
    with pytest.raises(ValueError, match=why):
        find_torque(name)


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
