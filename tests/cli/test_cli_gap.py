"""``hapticd gap`` on a recording with a hidden effect: what it says, what it writes, and what can be done with that."""

from __future__ import annotations

import errno
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import hapticd.gap.choose
from benchmarks.gap import devices
from benchmarks.gap.generate import STEP_S, generate
from hapticd.config import load_config
from tests.sim_hw.boards import running_board

from .conftest import Outcome, Run

HIDDEN = [{"name": "gravity", "m_g_l": 1.2e-3, "theta_0": 0.4}]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A recording of the testbed with a weight on an arm, and its nominal model."""
    folder = tmp_path_factory.mktemp("lab")
    made = generate(HIDDEN, 1, 6.0, "re35", step_s=4.0 * STEP_S)
    columns = {"time_s": made.time_s, "encoder_counts": made.counts, "current_command_A": made.current_command}
    run, model = folder / "lab.csv", folder / "model.yaml"
    np.savetxt(run, np.column_stack(list(columns.values())), "%.17g", ",", header=",".join(columns), comments="")
    model.write_text(yaml.safe_dump(devices.model("re35")))
    return run, model


def gap(hapticd: Run, recording: tuple[Path, Path], out: Path, *words: str) -> Outcome:
    return hapticd("gap", str(recording[0]), "--model", str(recording[1]), "-o", str(out), *words)


def test_the_answer_outlives_a_full_disk(
    hapticd: Run, recording: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*given: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path))

    monkeypatch.setattr("hapticd.gap.outputs.write_outputs", full)
    said = gap(hapticd, recording, tmp_path / "gap", "--effect", "gravity")
    assert said.code == 2
    assert "effect_found: Missing: gravity" in said.out
    assert "report.html" not in said.out
    assert "No space left on device" in said.err


def test_the_effect_is_named_in_words_and_the_model_can_be_used(
    hapticd: Run, recording: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "gap"
    said = gap(hapticd, recording, out)
    assert said.code == 0
    assert "effect_found: Missing: gravity" in said.out
    assert re.search(
        r"  gravity: m_g_l = 0\.0012 \(0\.0011\d+ … 0\.0012\d+\) N m, theta_0 = 0\.4 \(0\.39\d+ … 0\.4\d*\) rad",
        said.out,
    )
    assert "as a torque that depends on the position, most of it from" in said.out
    assert "N m after; noise floor" in said.out
    assert "predicted 50 ms ahead: off by" in said.out
    assert "predicted the whole record from its start" in said.out
    assert "left: " in said.out
    assert sorted(path.name for path in out.iterdir()) == ["gap.json", "model.yaml", "report.html"]
    document = json.loads((out / "gap.json").read_text())
    assert (document["interrupted"], document["gap"]["unit"]) == (False, "N m")

    model = out / "model.yaml"
    (effect,) = load_config(model).plant.effects
    assert (effect.model_extra or {})["m_g_l"] == pytest.approx(1.2e-3, rel=1e-2)
    check = hapticd("check", str(model), "--json")
    assert check.document["region"]
    run = tmp_path / "run.arrow"
    simulated = hapticd("simulate", str(model), "--duration", "0.2", "--deflection", "20", "-o", str(run), "--json")
    assert (simulated.code, simulated.document["ticks"]) == (0, 200)
    with running_board(tmp_path, plant=model.read_text()) as board:
        assert board.ready["ready"]
        board.stop()


def test_json_is_one_document(hapticd: Run, recording: tuple[Path, Path], tmp_path: Path) -> None:
    said = gap(hapticd, recording, tmp_path / "gap", "--effect", "gravity", "--json")
    assert said.document["effects"] == ["gravity"]
    assert said.document["prediction"]["unit"] == "rad"
    assert said.document == json.loads((tmp_path / "gap" / "gap.json").read_text())


def lab_run(folder: Path, name: str, rows: int) -> Path:
    """The beginning of another recording of the device with the weight."""
    made = generate(HIDDEN, 2, 3.0, "re35", step_s=4.0 * STEP_S)
    columns = {"time_s": made.time_s, "encoder_counts": made.counts, "current_command_A": made.current_command}
    run, values = folder / name, np.column_stack(list(columns.values()))[:rows]
    np.savetxt(run, values, "%.17g", ",", header=",".join(columns), comments="")
    return run


def test_a_recording_that_is_not_fitted_tests_the_model(
    hapticd: Run, recording: tuple[Path, Path], tmp_path: Path
) -> None:
    other, out = lab_run(tmp_path, "other.csv", 3000), tmp_path / "gap"
    said = gap(hapticd, recording, out, "--effect", "gravity", "--validate", str(other))
    assert said.code == 0, said.err
    assert "validated on other.csv, which was not fitted: 50 ms ahead: off by" in said.out
    assert "other.csv: 3 s is short" in said.err
    found = json.loads((out / "gap.json").read_text())["validation"]
    assert (found["run"], found["verdict"]) == ("other.csv", "better")
    assert found["k_step"]["after"] < 0.2 * found["k_step"]["before"]
    report = (out / "report.html").read_text()
    assert 'alt="measured and predicted position"' in report
    assert found["words"] in report


def test_a_recording_that_cannot_test_is_refused(hapticd: Run, recording: tuple[Path, Path], tmp_path: Path) -> None:
    out, short = tmp_path / "gap", lab_run(tmp_path, "short.csv", 500)
    axis = tmp_path / "axis.arrow"
    assert hapticd("simulate", "mit_toolhandle", "--duration", "2", "--deflection", "20", "-o", str(axis)).code == 0
    for test, statement in (
        (recording[0], "lab.csv and lab.csv are the same recording: name it once; a fitted recording is no test"),
        (short, "s are too short; at least 1 s are needed"),
        (axis, "a run of a linear device (m, N), but the model is a rotary device (rad, N m)"),
        (tmp_path / "nothing.csv", "nothing.csv"),
        (out / "gap.json", "gap.json is the file that is read"),
    ):
        out.mkdir(exist_ok=True)
        (out / "gap.json").write_text("{}")
        said = gap(hapticd, recording, out, "--force", "--validate", str(test))
        assert said.code == 2
        assert statement in said.err.replace("\n", " ")
        assert (out / "gap.json").read_text() == "{}"


def interrupted_in(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C in that round of the search."""
    extensions, rounds = hapticd.gap.choose.extensions, 0

    def competing(*words: Any) -> Any:
        nonlocal rounds
        rounds += 1
        if rounds == number:
            raise KeyboardInterrupt
        return extensions(*words)

    monkeypatch.setattr("hapticd.gap.choose.is_at_noise_level", lambda fit: False)
    monkeypatch.setattr("hapticd.gap.choose.extensions", competing)


def test_an_interruption_keeps_what_was_named(
    hapticd: Run, recording: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted_in(2, monkeypatch)
    said = gap(hapticd, recording, tmp_path / "gap", "--effect", "gravity")
    assert said.code == 130
    assert "effect_found: Interrupted: Missing: gravity" in said.out
    assert "interrupted" in said.err
    document = json.loads((tmp_path / "gap" / "gap.json").read_text())
    assert document["interrupted"] is True
    assert load_config(tmp_path / "gap" / "model.yaml").plant.effects[0].name == "gravity"
    assert (
        "Interrupted; missing from the model, as far as the search went: gravity"
        in (tmp_path / "gap" / "report.html").read_text()
    )


def test_an_interruption_before_anything_was_named_leaves_the_folder_alone(
    hapticd: Run, recording: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted_in(1, monkeypatch)
    said = gap(hapticd, recording, tmp_path / "gap", "--effect", "gravity")
    assert said.code == 130
    assert not (tmp_path / "gap").exists()
