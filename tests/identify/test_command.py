"""``hapticd identify`` as a command: what it says and writes, and what it refuses before anything is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from hapticd.config import load_config

from ..cli.conftest import Run, hapticd
from ..gap.synthetic import INERTIA
from .synthetic import recorded, wrong_model

__all__ = ["hapticd"]


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A recording whose encoder counts against the torque, and a config that is wrong in the plant."""
    folder = tmp_path_factory.mktemp("rig")
    run = recorded(sign=-1)
    counts = np.floor(run.position / run.resolution)
    table = np.column_stack([run.time_s, counts, run.current])
    header = "time_s,encoder_counts,current_command_A"
    np.savetxt(folder / "run.csv", table, "%.17g", ",", header=header, comments="")
    text = "# my rig\n" + yaml.safe_dump(wrong_model().model_dump(mode="json", exclude_defaults=True))
    (folder / "rig.yaml").write_text(text)
    return folder / "run.csv", folder / "rig.yaml"


def test_the_config_is_written_and_checks_with_a_probability(hapticd: Run, rig: tuple[Path, Path]) -> None:
    run, config = rig
    said = hapticd("identify", str(run), "--model", str(config), "-o", str(config), "--json")
    assert said.code == 0, said.err
    inertia = said.document["plant"]["inertia"]
    assert inertia["value"] == pytest.approx(INERTIA, rel=0.03)
    assert inertia["ci95"][0] < inertia["value"] < inertia["ci95"][1]
    assert said.document["config"] == str(config)
    written = load_config(config)
    assert written.plant.inertia == pytest.approx(inertia["value"], rel=1e-5)
    assert written.encoder.invert
    assert config.read_text().startswith("# my rig\n")
    again = hapticd("identify", str(run), "--model", str(config), "-o", str(config), "--json")
    assert again.document["encoder"]["sign"] == 1, "what was put right stays right"
    assert "encoder.invert of the model is true, and the file has no config: positions are turned round" in again.err
    assert load_config(config).encoder.invert
    checked = hapticd("check", str(config), "--json")
    assert 0.0 <= checked.document["probability"]["stable"] <= 1.0


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ([], "name at least one recording, or --live"),
        (["run.csv", "--live"], "--live makes its own recordings"),
        (["run.csv", "--keep-spring"], "--keep-spring goes with --live"),
        (["run.csv", "--set", "servo.rate_hz=500"], "--set changes the model of --model"),
        (["run.csv", "--known-inertia", "-1"], "known-inertia"),
    ],
)
def test_what_cannot_be_meant_is_refused(hapticd: Run, words: list[str], why: str) -> None:
    said = hapticd("identify", *words)
    assert said.code == 2
    assert why in said.err


def test_another_file_is_not_overwritten(hapticd: Run, tmp_path: Path) -> None:
    out = tmp_path / "other.yaml"
    out.write_text("servo: {}\n")
    said = hapticd("identify", "run.csv", "-o", str(out))
    assert said.code == 2
    assert "exists; give another name, or --force to replace it, or update it with --model" in said.err
    assert out.read_text() == "servo: {}\n"
