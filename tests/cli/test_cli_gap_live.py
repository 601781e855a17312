"""``hapticd gap --live`` before anything moves: what is refused, and that the daemon's own config is the model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hapticd.gap import GapResult
from hapticd.gap.result import GapNumbers, Remainder

from ..service.fake_control import FakeControl
from .conftest import Run


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "name at least one recording, or --live"),
        (("--live", "run.arrow"), "--live makes its own recordings"),
        (("run.arrow", "--excite", "steps"), "--excite goes with --live"),
        (("--live", "--effect", "stribek"), "--effect stribek: not in the catalogue; did you mean stribeck?"),
        (("--live", "--excite", "nowhere.yaml"), "nowhere.yaml"),
        (("--live", "--excite", "chrip"), "excitation 'chrip' is unknown"),
    ],
)
def test_what_cannot_be_meant_is_refused(daemon: Run, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    outcome = daemon("gap", "-o", str(tmp_path / "gap"), *words)
    assert outcome.code == 2
    assert said in outcome.err
    assert not (tmp_path / "gap").exists()


def test_without_a_daemon_it_says_how_to_start_one(hapticd: Run, tmp_path: Path) -> None:
    outcome = hapticd("gap", "--live", "-o", str(tmp_path), "--socket", str(tmp_path / "none.sock"))
    assert outcome.code == 3
    assert "hapticd run" in outcome.err


def test_a_fault_during_the_experiment_ends_it_with_the_recording_named(
    daemon: Run, control: FakeControl, tmp_path: Path
) -> None:
    control.job_states = [("done", 1.0)]
    control.job_result = {"run": "/r/excite.arrow", "fault": "over_speed"}
    outcome = daemon("gap", "--live", "--excite", "steps", "-o", str(tmp_path / "gap"))
    assert outcome.code == 5
    assert "steps ended early on the fault over_speed; its recording is /r/excite.arrow" in outcome.err
    assert not (tmp_path / "gap").exists()


def test_the_daemons_config_is_the_model_unless_one_is_named(
    daemon: Run, control: FakeControl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    control.job_states = [("done", 1.0)] * 2
    control.job_result = {"run": "/r/excite.arrow"}
    inertias: list[float] = []

    def find(recordings: Any, model: Any, **options: Any) -> GapResult:
        inertias.append(model.plant.inertia)
        numbers = GapNumbers(1e-6, 1e-6, 1e-6, 1e-6, 1e-7, "N m")
        timing = {"missed": 0, "jitter_s": 0.0, "period_s": 1e-3, "warnings": []}
        return GapResult("no_missing_effect", "Nothing.", (), (), numbers, Remainder(1.0, "All.", ()), recording=timing)

    monkeypatch.setattr("hapticd.gap.find_gap", find)
    monkeypatch.setattr("hapticd.gap.live.load_recording", lambda path, model: path)
    monkeypatch.setattr("hapticd.gap.outputs.write_outputs", lambda *given: None)
    monkeypatch.setattr(
        "hapticd.gap.outputs.document_of",
        lambda result, model: {**result.to_json(), "consequences": {"words": []}, "next": ""},
    )
    for words in ((), ("--model", "omega")):
        assert daemon("gap", "--live", "--excite", "steps", "-o", str(tmp_path), *words).code == 0
    assert inertias[0] == control.resolved.plant.inertia != inertias[1]
