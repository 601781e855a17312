"""What is exported to MuJoCo moves there as hapticd's plant does; and a URDF, which MuJoCo reads as well."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.config import Config, load_config, parse_config
from hapticd.effects.catalogue import OWN_SLUGS
from hapticd.export import TABLE, write_model
from hapticd.export.axis_numbers import axis_numbers
from hapticd.export.loss import excitation, loss_of_urdf
from tests.export.cases import CASES, PERIOD_S, POSITION, VELOCITY, commands, config_of, loaded, off_by, reference

mujoco = pytest.importorskip("mujoco")

_MJCF = TABLE["mjcf"]
ALONE = [slug for slug in OWN_SLUGS if _MJCF[slug].how == "exact" and "the module" not in _MJCF[slug].where]
"""What the MJCF file says without its module."""


@pytest.fixture(autouse=True)
def _no_callback() -> Iterator[None]:
    yield
    mujoco.set_mjcb_passive(None)


def moved(
    model: Any, currents: np.ndarray | None = None, position: float = POSITION, velocity: float = VELOCITY
) -> np.ndarray:
    """Positions after each command."""
    data = mujoco.MjData(model)
    data.joint("joint").qpos[0], data.joint("joint").qvel[0] = position, velocity
    steps = round(PERIOD_S / model.opt.timestep)
    model.opt.timestep = PERIOD_S / steps
    positions = []
    for current in (commands() if currents is None else currents).tolist():
        data.ctrl[0] = current
        for _ in range(steps):
            mujoco.mj_step(model, data)
        positions.append(data.joint("joint").qpos[0])
    return np.array(positions)


def in_mujoco(config: Config, folder: Path, *, with_module: bool = True) -> np.ndarray:
    files = write_model(config, "mjcf", folder / "rig.xml")
    model = mujoco.MjModel.from_xml_path(str(files[0]))
    if with_module and len(files) > 1:
        loaded(files[1]).install(model)
    return moved(model)


@pytest.mark.parametrize("case", CASES)
def test_it_moves_as_the_plant_does(case: str, tmp_path: Path) -> None:
    config = config_of(case)
    assert off_by(in_mujoco(config, tmp_path), reference(config)) < 0.01


@pytest.mark.parametrize("slug", ALONE)
def test_what_mjcf_says_needs_no_module(slug: str, tmp_path: Path) -> None:
    config = config_of(slug)
    assert off_by(in_mujoco(config, tmp_path, with_module=False), reference(config)) < 0.01


def test_no_module_where_mjcf_says_it_all(tmp_path: Path) -> None:
    config = config_of("constant_bias", amplifier={"bandwidth_hz": 0, "dac_bits": 0})
    files = write_model(config, "mjcf", tmp_path / "rig.xml")
    assert [path.name for path in files] == ["rig.xml"]
    assert off_by(moved(mujoco.MjModel.from_xml_path(str(files[0]))), reference(config)) < 0.01


def test_the_module_says_what_the_encoder_sees(tmp_path: Path) -> None:
    files = write_model(config_of("encoder_eccentricity"), "mjcf", tmp_path / "my rig.xml")
    assert files[1].name == "my_rig_mujoco.py"
    model = mujoco.MjModel.from_xml_path(str(files[0]))
    passive, data = loaded(files[1]).install(model), mujoco.MjData(model)
    data.qpos[0] = 2.0
    mujoco.mj_forward(model, data)
    assert passive.measured(data) == pytest.approx(2.0 + 0.9 * np.sin(2.3))


def test_a_reset_begins_anew(tmp_path: Path) -> None:
    files = write_model(config_of("presliding"), "mjcf", tmp_path / "rig.xml")
    model = mujoco.MjModel.from_xml_path(str(files[0]))
    loaded(files[1]).install(model)
    first = moved(model)
    assert np.array_equal(moved(model), first)


def test_another_model_is_left_alone(tmp_path: Path) -> None:
    files = write_model(config_of("stribeck"), "mjcf", tmp_path / "rig.xml")
    other = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint type="hinge"/><geom size="1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(other)
    loaded(files[1]).install(mujoco.MjModel.from_xml_path(str(files[0])))
    mujoco.mj_step(other, data)
    assert data.qfrc_passive[0] == 0.0


def linear() -> Config:
    effects = [{"name": "constant_bias", "tau_0": 0.5}, {"name": "return_spring", "k_s": 2.0}]
    return parse_config(
        {
            "encoder": {"counts_per_rev": None, "counts_per_metre": 1e6},
            "plant": {"inertia": 0.5, "viscous": 2.0, "coulomb": 0.4, "effects": effects},
            "amplifier": {"torque_constant": 10.0},
        },
        "linear",
    )


def test_a_slide(tmp_path: Path) -> None:
    assert off_by(in_mujoco(linear(), tmp_path), reference(linear())) < 0.01


@pytest.mark.parametrize("preset", ["re35", "delta", "freedom6", "impulse_engine", "phantom"])
def test_friction_holds_and_lets_go_as_stiction_does(preset: str, tmp_path: Path) -> None:
    config = load_config(preset)
    files = write_model(config, "mjcf", tmp_path / "rig.xml")
    model = mujoco.MjModel.from_xml_path(str(files[0]))
    data, coulomb = mujoco.MjData(model), config.plant.coulomb
    breaks_away = coulomb / config.amplifier.torque_constant
    data.ctrl[0] = 0.9 * breaks_away
    for _ in range(1000):
        mujoco.mj_step(model, data)
    passed = 1000 * model.opt.timestep
    # a thousandth of where the same torque would take it without friction
    assert abs(data.qpos[0]) < 1e-3 * 0.5 * 0.9 * coulomb / config.plant.inertia * passed**2
    data.ctrl[0] = 2.0 * breaks_away
    for _ in range(10):
        mujoco.mj_step(model, data)
    assert data.qfrc_constraint[0] == pytest.approx(-coulomb, rel=1e-6)


IN_URDF = [slug for slug in OWN_SLUGS if TABLE["urdf"][slug].how == "exact"]


@pytest.mark.parametrize("case", ["nothing", *IN_URDF])
def test_a_urdf_moves_as_the_plant_does(case: str, tmp_path: Path) -> None:
    config = config_of(case, amplifier={"bandwidth_hz": 0, "dac_bits": 0})
    (path,) = write_model(config, "urdf", tmp_path / "rig.urdf")
    spec = mujoco.MjSpec.from_file(str(path))
    motor = spec.add_actuator(target="joint", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.gear[0] = config.amplifier.torque_constant
    model = spec.compile()
    # MuJoCo's own default friction creeps; the solver is no part of a URDF.
    model.opt.timestep, model.dof_solref[0], model.dof_solimp[0, :2] = 1e-4, (-1.0, -1e4), 0.9999
    assert off_by(moved(model), reference(config)) < 0.01


@pytest.mark.parametrize("case", [*IN_URDF, *(slug for slug in OWN_SLUGS if slug not in IN_URDF), "degressive"])
def test_what_a_urdf_loses_is_what_it_is_off_by_in_mujoco(case: str, tmp_path: Path) -> None:
    config = config_of(case)
    (path,) = write_model(config, "urdf", tmp_path / "rig.urdf")
    spec = mujoco.MjSpec.from_file(str(path))
    motor = spec.add_actuator(target="joint", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.gear[0] = axis_numbers(config).torque_constant
    model = spec.compile()
    model.opt.timestep, model.dof_solref[0], model.dof_solimp[0, :2] = 1e-4, (-1.0, -1e4), 0.9999
    commands, said = excitation(config), loss_of_urdf(config)
    right, near = reference(config, commands, 0.0, 0.0), moved(model, commands, 0.0, 0.0)
    # Two solvers, each within 1 % of the joint's law.
    assert said.share == pytest.approx(off_by(near, right), rel=0.05, abs=0.015)
    assert f"off by up to {100 * said.share:.2g} % of the travel" in path.read_text()


def test_a_slide_as_urdf(tmp_path: Path) -> None:
    (path,) = write_model(linear(), "urdf", tmp_path / "rig.urdf")
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.dof_damping[0] == 2.0
    assert model.dof_frictionloss[0] == 0.4
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_SLIDE
