"""The measured data sets, where they are (HAPTICD_DATASETS); they are not part of the repository."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gap_real import emps, odrive
from benchmarks.gap_real.answer import beginning
from benchmarks.gap_real.datasets import COGGING, COGGING_MAP, VARIABLE, folder, imported
from benchmarks.report import BenchmarkError
from hapticd.gap import find_gap

needs_data = pytest.mark.skipif(
    not Path(os.environ.get(VARIABLE) or "/nowhere").is_dir(),
    reason=f"needs measured data: name their folder in {VARIABLE}",
)


@needs_data
def test_the_usual_recipe_gives_the_reference_figures_on_emps(tmp_path: Path) -> None:
    figures = emps.by_recipe(emps.record(folder(), tmp_path))
    assert [figure.value for figure in figures] == pytest.approx([3.82, 2.16, 1.64], rel=0.005)


@needs_data
def test_the_free_run_of_the_published_model_needs_its_offset(tmp_path: Path) -> None:
    rigid, with_offset = emps.rigid_free_runs(emps.record(folder(), tmp_path))
    assert with_offset.value < 10.0 < rigid.value


@needs_data
@pytest.mark.timeout(1200)
def test_what_the_rigid_model_of_emps_lacks_is_named(tmp_path: Path) -> None:
    found = find_gap([emps.record(folder(), tmp_path)], emps.nominal(), design=False)
    assert set(found.effects) == {"asymmetric_viscous", "stribeck"}
    assert found.verdict == "partly_explained"
    assert found.details["predicted_better_by"] == {"amplifier_lag": "change of the current"}
    rises = next(step for step in found.steps if step.effect == "stribeck").parameters["s"].value
    assert -0.6 < rises < -0.2
    assert found.gap.held_out_after < 0.5 * found.gap.held_out_before


@needs_data
def test_the_cogging_motor_is_imported_in_the_drive_s_own_steps(tmp_path: Path) -> None:
    recording = imported(folder() / COGGING[0], odrive.MAP, odrive.guessed_model(), tmp_path)
    assert recording.resolution == pytest.approx(2.0 * np.pi / 8192 / 64)
    assert 0.9 < np.ptp(recording.position) / (2.0 * np.pi) < 1.1
    part = beginning(recording, 2.0)
    assert part.duration_s == pytest.approx(2.0, abs=0.01)
    assert part.current.size == part.rows < recording.rows
    assert odrive.orders_of(np.load(folder() / COGGING_MAP)) == [7, 28, 14, 36, 12]


@needs_data
@pytest.mark.timeout(1200)  # the longest search of all; minutes where others compute beside it
def test_the_cogging_motor_s_ripple_is_named_from_a_poor_guess(tmp_path: Path) -> None:
    """Its inertia is some forty times the guess, and its current was filtered before it was recorded."""
    model = odrive.guessed_model()
    recording = imported(folder() / COGGING[1], odrive.MAP, model, tmp_path)
    found = find_gap([recording], model, design=False)
    assert {"torque_ripple", "inertia_error"} <= set(found.effects)
    strongest = set(odrive.orders_of(np.load(folder() / COGGING_MAP)))
    assert strongest <= set(odrive.named_orders(found.to_json()))
    assert 2e-3 < found.base["inertia"].value < 8e-3
    assert "current_filter_s" in found.recording
    assert found.gap.held_out_after < 0.25 * found.gap.held_out_before


def test_the_orders_of_a_named_ripple_are_read() -> None:
    ripple = {"effect": "torque_ripple", "parameters": {"orders[0]": {"value": 7.0}, "orders[1]": {"value": 12.0}}}
    assert odrive.named_orders({"steps": [{"effect": "stribeck", "parameters": {}}, ripple]}) == [7.0, 12.0]
    assert odrive.named_orders({"steps": []}) == []


def test_without_data_the_benchmark_says_what_it_needs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(BenchmarkError, match=f"name their folder in {VARIABLE}"):
        folder()
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with pytest.raises(BenchmarkError, match=r"lacks emps/DATA_EMPS\.mat"):
        folder()
