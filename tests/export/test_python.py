"""The exported Python module moves as hapticd's plant does, and needs nothing of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hapticd.effects import encoder_eccentricity
from hapticd.export import write_model
from hapticd.servo.simulate import simulate
from tests.export.cases import CASES, PERIOD_S, POSITION, VELOCITY, commands, config_of, loaded, off_by, reference


@pytest.mark.parametrize("case", CASES)
def test_it_moves_as_the_plant_does(case: str, tmp_path: Path) -> None:
    config = config_of(case)
    (path,) = write_model(config, "python", tmp_path / "axis_model.py")
    module = loaded(path)
    axis = module.Axis(module.MODEL, POSITION, VELOCITY)
    positions = []
    for current in commands().tolist():
        axis.step(current, PERIOD_S)
        positions.append(axis.position)
    right = reference(config)
    assert off_by(np.array(positions), right) < (0.01 if case == "dropped_samples" else 1e-3)
    if case not in ("nothing", "dropped_samples", "encoder_eccentricity"):
        # without the effect it would be another motion
        assert off_by(right, reference(config_of("nothing"))) > 0.02


def test_the_encoder_sees_its_eccentricity(tmp_path: Path) -> None:
    (path,) = write_model(config_of("encoder_eccentricity"), "python", tmp_path / "axis_model.py")
    module = loaded(path)
    axis = module.Axis(module.MODEL, 2.0)
    assert axis.measured == pytest.approx(encoder_eccentricity.measured(2.0, 0.9, 0.3), rel=1e-12)
    assert axis.counts == int(axis.measured / config_of("nothing").raw_resolution)


def test_it_needs_nothing_but_python(tmp_path: Path) -> None:
    write_model(config_of("stribeck"), "python", tmp_path / "axis_model.py")
    code = "import axis_model as m; print(m.simulate([0, 1e-3, 2e-3], [1, 1, 1])[-1] > 0, m.torque(0, 0, 1, 0) > 0)"
    done = subprocess.run(
        [sys.executable, "-S", "-c", code], cwd=tmp_path, env={}, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True", "True"]


def test_torque_is_the_law(tmp_path: Path) -> None:
    (path,) = write_model(config_of("gravity"), "python", tmp_path / "axis_model.py")
    torque = loaded(path).torque
    moving = 0.0292 * 0.3 - 3e-3 * np.sin(1.0 - 0.4) - 2e-3 - 9e-6 * 7.0
    assert torque(1.0, 7.0, 0.3, 0.0) == pytest.approx(moving, rel=1e-12)
    assert torque(0.4, 0.0, 0.03, 0.0) == 0.0  # stiction holds
    assert torque(0.4, 0.0, -0.1, 0.0) == pytest.approx(-0.0292 * 0.1 + 2e-3, rel=1e-12)


@pytest.mark.parametrize("case", ["nothing", "several", "backlash"])
def test_a_spring_on_it_is_what_simulate_says(case: str, tmp_path: Path) -> None:
    config = config_of(
        case, spring={"stiffness": 0.03, "damping": 1e-4}, encoder={"counts_per_rev": 8192, "decimation": 1}
    )
    (path,) = write_model(config, "python", tmp_path / "axis_model.py")
    module = loaded(path)
    # from where the spring's origin is in the middle of a tick, as in simulate
    begin = 600.3 * config.raw_resolution
    axis = module.Axis(module.MODEL, begin)
    counts = []
    for _ in range(500):
        counts.append(axis.counts)
        before = counts[-2] if len(counts) > 1 else counts[-1]
        force = -0.03 * config.resolution * (axis.counts + 0.5)
        force -= 1e-4 * (counts[-1] - before) * config.resolution / config.period
        axis.step(force / config.amplifier.torque_constant, config.period)
    rows = []
    simulate(config, 0.5, deflection=600.3, on_rows=lambda found: rows.append(found["encoder_counts"].copy()))
    measured = np.concatenate(rows)[:500]
    assert off_by(np.array(counts, float), measured.astype(float)) < 0.01
