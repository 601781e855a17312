"""The last chapter of docs/code-overview.md, step by step: an effect, a driver, a setting, an endpoint, a fault."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numba
import numpy as np
import pytest
import typer
from annotated_types import Ge
from typer.testing import CliRunner

from docs.config_page import key_sections
from hapticd.cli.command import add_commands, command
from hapticd.client import Client, RequestRefused
from hapticd.config import ConfigError, keys, parse_config
from hapticd.config import loading as config_loading
from hapticd.config.fields import Number, Section, quantity
from hapticd.config.model import Config
from hapticd.config.sections import Spring
from hapticd.control.endpoints import Endpoints, JsonDict, endpoint
from hapticd.service.api import create_app
from hapticd.servo import atomics, faults
from hapticd.servo import core as servo_core
from hapticd.servo import layout as w
from hapticd.servo.gate import raise_fault
from hapticd.servo.loop import take_parameters
from tests.service.fake_control import FakeControl, serve
from tests.servo.scripted import Scripted, config, core_for

ROOT = Path(__file__).parents[1]

EFFECT = """
from hapticd.effects import Effect, Notes, magnitude

def force(position, velocity, time, current, k):
    return -k * position ** 3

EFFECT = Effect(
    slug="hardening_spring", summary="A spring that hardens.", law="−k θ³",
    parameters=(magnitude("k", ("N m/rad³", "N/m³"), 1e4),),
    acts_on="force", source="Duffing.", where_it_shows="Over position, as its cube.", example="k: 1.0",
    notes=Notes(told_apart="`return_spring` is linear.", shown_by="slow motion far out."),
    amplitude="k", grid=lambda scale: [{"k": 0.1}], near=("return_spring",), force=force,
)
"""

DRIVER = '''
from drivers import PythonDriver

class Bench(PythonDriver):
    """A shaft that is clamped."""
    summary = "clamped shaft"
    latency_s = 250e-6

    def connect(self): pass
    def disconnect(self): pass
    def read_counts(self): return 7
    def write_current(self, current, enable): pass

    @classmethod
    def max_rate_hz(cls, config): return 800.0
'''


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """An environment in which a package with these two files is installed: modules and entry points, as pip leaves them."""
    (tmp_path / "lab_effect.py").write_text(EFFECT, encoding="utf-8")
    (tmp_path / "lab_driver.py").write_text(DRIVER, encoding="utf-8")
    metadata = tmp_path / "lab-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(
        "[hapticd.effects]\nhardening_spring = lab_effect:EFFECT\n[hapticd.drivers]\nbench = lab_driver:Bench\n"
    )
    return {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))}


def hapticd(environment: dict[str, str], *arguments: str) -> Any:
    done = subprocess.run(
        [sys.executable, "-m", "hapticd.cli", *arguments, "--json"],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_an_effect(installed: dict[str, str]) -> None:
    """One file with an `Effect`, one entry point: then a model may list it, and the simulator has it."""
    release = ("simulate", "--duration", "0.02", "--deflection", "400")
    bare = hapticd(installed, *release)
    listed = hapticd(installed, *release, "--set", "plant.effects=[{name: hardening_spring, k: 50.0}]")
    assert bare["final"]["position_ticks"] != pytest.approx(listed["final"]["position_ticks"], abs=1e-3)


def test_a_driver(installed: dict[str, str]) -> None:
    """One class, one entry point: then it is listed, and `check` knows its latency and what its link carries."""
    listed = {driver["name"]: driver for driver in hapticd(installed, "drivers")["drivers"]}
    assert (listed["bench"]["summary"], listed["bench"]["error"]) == ("clamped shaft", None)
    document = hapticd(installed, "check", "--set", "driver.name=bench")
    assert document["tau_d"] == pytest.approx(hapticd(installed, "check")["tau_d"] + 250e-6 * 1000)
    assert "servo.rate_hz is 1000 Hz, but driver bench allows 800 Hz" in document["warnings"]


class HardeningSpring(Spring):
    """The rendered virtual spring (eq. 2)."""

    cubic: Number = quantity(0.0, "Cubic part of the stiffness", "N m/rad³", linear="N/m³", ge=0)


class LabConfig(Config):
    """With one setting more."""

    spring: HardeningSpring = quantity(HardeningSpring, "Virtual spring")


@pytest.fixture
def _with_a_setting(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    cached = (keys.leaf_fields, keys.section_models)
    monkeypatch.setattr(keys, "Config", LabConfig)
    monkeypatch.setattr(config_loading, "Config", LabConfig)
    for function in cached:
        function.cache_clear()
    yield
    for function in cached:
        function.cache_clear()


@pytest.mark.usefixtures("_with_a_setting")
def test_a_setting() -> None:
    """One line in its section: then it is read, refused by name, limit and unit, and on the reference page."""
    assert issubclass(HardeningSpring, Section)
    assert parse_config({"spring": {"cubic": 2.5}}, "rig.yaml").spring.model_dump()["cubic"] == 2.5
    with pytest.raises(ConfigError) as wrong:
        parse_config({"spring": {"cubic": -1}}, "rig.yaml")
    (problem,) = wrong.value.problems
    assert (problem.key, problem.limit, problem.unit) == ("spring.cubic", 0, "N m/rad³")
    with pytest.raises(ConfigError, match=r"spring\.cubic"):
        parse_config({"spring": {"cubik": 1}}, "rig.yaml")
    assert "| `spring.cubic` | N m/rad³, N/m³ |" in key_sections()


LAB_PARAMS = np.dtype([*((name, w.PARAMS[name]) for name in w.PARAMS.names or ()), ("cubic", "f8")], align=True)
_CHANGED = {"params": LAB_PARAMS, "mailbox": np.dtype((LAB_PARAMS, 3))}
LAB_SERVO = np.dtype([(name, _CHANGED.get(name, w.SERVO[name])) for name in w.SERVO.names or ()], align=True)


def _lab_parameters(cfg: Config) -> np.void:
    p = servo_core.parameters(cfg, servo_core.Request(state=w.RUNNING))
    p["cubic"] = cfg.spring.model_dump()["cubic"] * cfg.resolution**3
    return p


@pytest.mark.usefixtures("_with_a_setting")
def test_a_setting_of_the_servo_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """A field of `PARAMS` and its value in `parameters`: then the loop has it in force, and takes a new one."""
    signature = numba.void(numba.from_dtype(LAB_SERVO), numba.int64[::1], numba.from_dtype(LAB_PARAMS))
    monkeypatch.setattr(servo_core, "PARAMS", LAB_PARAMS)
    monkeypatch.setattr(servo_core, "SERVO", LAB_SERVO)
    monkeypatch.setattr(servo_core, "publish", numba.njit(signature)(servo_core.publish.py_func))
    take = numba.njit(take_parameters.py_func)
    driver = Scripted(config())
    driver.open()
    core = servo_core.ServoCore(driver, ring_rows=1024, excitation_rows=256)
    first, second = (parse_config({"spring": {"cubic": value}}, "rig.yaml") for value in (2.5, 4.0))
    core.publish(_lab_parameters(first))
    core.begin(0)
    assert core.params["cubic"] == 2.5 * first.resolution**3
    core.publish(_lab_parameters(second))
    assert take(core.memory[0], core.shared)
    assert core.params["cubic"] == 4.0 * second.resolution**3
    assert core.params["force_per_tick"] == second.spring.stiffness * second.resolution
    assert not take(core.memory[0], core.shared)


class _Lab(Endpoints):
    @endpoint("POST", "/nudge", "Status")
    def nudge(
        self, counts: Annotated[int, Ge(1), "In raw counts."], twice: Annotated[bool, "Again."] = False
    ) -> JsonDict:
        """Move the spring's origin a little.

        The shaft follows.
        """


class _LabControl(FakeControl):
    def nudge(self, counts: int, twice: bool = False) -> JsonDict:
        self.calls.append(("nudge", counts, twice))
        return self.status()


@pytest.mark.realtime
def test_an_endpoint(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One method of `Endpoints`, one of the daemon: then route, checks, document, client and help of a command are there."""
    monkeypatch.setattr(Endpoints, "nudge", _Lab.nudge, raising=False)
    control = _LabControl()
    with serve(control, tmp_path / "s") as client:
        assert client.nudge(3)["state"] == "off"  # type: ignore[attr-defined]
        Client.nudge(client, counts=4, twice=True)  # type: ignore[attr-defined]
        with pytest.raises(RequestRefused) as refusal:
            client.nudge(0)  # type: ignore[attr-defined]
    assert control.calls == [("nudge", 3, False), ("nudge", 4, True)]
    assert (refusal.value.code, refusal.value.message) == (
        "request",
        "counts: input should be greater than or equal to 1, got 0",
    )
    operation = create_app(control).openapi()["paths"]["/nudge"]["post"]
    assert operation["description"] == "Move the spring's origin a little.\n\nThe shaft follows."
    app = typer.Typer()
    app.callback()(lambda: None)
    nudge = command("hapticd nudge", endpoint=_Lab.nudge)(lambda: None)
    add_commands(app, {"nudge": nudge})
    assert "Move the spring's origin a little." in CliRunner().invoke(app, ["nudge", "--help"]).output


def test_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """One number and one sentence, raised in the gate: then it is latched, and told with what tripped it."""
    number = max(faults.KINDS) + 1
    monkeypatch.setitem(
        faults.KINDS, number, faults.FaultKind("too_hot", "the motor is at {value:.0f} °C, limit {limit:.0f}")
    )
    driver = Scripted(config())
    core = core_for(driver, driver.config)
    raise_fault(core.memory[0], core.shared, number, 130.0, 120.0)
    assert (core.load(atomics.MODE), core.load(atomics.FAULT_CODE)) == (w.FAULT, number)
    value, limit = core.fault_numbers
    assert faults.describe(number, value, limit, is_linear=False) == {
        "code": "too_hot",
        "cause": "the motor is at 130 °C, limit 120",
        "help": "hapticd help too_hot",
    }


def test_every_fault_has_its_page() -> None:
    assert {path.stem for path in (ROOT / "docs" / "faults").glob("*.md")} >= set(faults.NUMBERS)
