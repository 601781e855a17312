"""The plan, the seal, going on after a stop, and the report, with a workflow that is made up."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.gap import __main__ as command
from benchmarks.gap import cases, collect, plan, report, tasks
from benchmarks.gap.hidden import LAWS
from hapticd.config import load_config
from hapticd.record import read_run

SMALL = plan.Size(seeds=1, pairs=2, none=2, left_out=1, duration_s=2.0)


def test_the_plan_has_every_effect_at_every_strength_and_is_drawn_by_seed() -> None:
    drawn = plan.draw(plan.FULL, 3)
    assert drawn == plan.draw(plan.FULL, 3)
    assert drawn != plan.draw(plan.FULL, 4)
    assert len({case.name for case in drawn}) == len(drawn)
    single = {(case.slugs[0], case.strength) for case in drawn if case.kind == "single"}
    assert single == {(slug, strength) for slug in LAWS for strength in ("barely", "clear", "strong")}
    assert sum(case.kind == "none" for case in drawn) >= 300
    assert {case.form for case in drawn} == {"csv", "parquet", "arrow"}


def test_what_is_left_out_is_the_whole_exact_class() -> None:
    case = plan.Case("left_out", ("constant_bias",), "clear", 1, "re35", "csv", 20.0)
    assert case.excluded == ("asymmetric_coulomb", "constant_bias")
    assert replace(case, kind="single").excluded == ()


@pytest.mark.parametrize("form", cases.FORMS)
def test_the_workflow_gets_a_readable_run_and_the_nominal_model_and_nothing_else(form: str, tmp_path: Path) -> None:
    case = plan.Case("single", ("coulomb_friction",), "strong", 5, "re35", form, 2.0)
    files, truth = tasks.make(case)
    assert set(files) == {f"run.{form}", "model.yaml"}
    assert truth["visibility"] == pytest.approx(6.0, rel=0.2)
    for content in files.values():
        assert b"coulomb_friction" not in content
        assert b"visibility" not in content
    cases.write_files(tmp_path, files)
    model = load_config(tmp_path / "model.yaml")
    assert model.plant.coulomb == pytest.approx(2e-3)
    assert model.plant.effects == ()
    columns = read_run(tmp_path / f"run.{form}").columns
    late = columns["wake_late_ns"] * 1e-9 if form == "arrow" else 0.0
    instants = columns["time_s"] + late
    assert np.all(np.diff(instants) > 0.0)
    assert np.std(np.diff(instants)) > 1e-6
    assert np.ptp(columns["encoder_counts"]) > 200


def guess(files: dict[str, bytes], excluded: Sequence[str]) -> dict[str, Any]:
    ends = {"effects": ["stribeck"], "steps": [], "gap": {}} if not excluded else {"effects": [], "steps": []}
    return {"verdict": "effect_found" if not excluded else "unexplained", **ends, "wall_s": 0.1, "peak_memory_MB": 1.0}


def test_it_goes_on_where_it_was_stopped_and_reports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = [case for case in plan.draw(SMALL) if set(case.slugs) <= {"stribeck", "constant_bias"}]
    asked = []

    def counted(files: dict[str, bytes], excluded: Sequence[str]) -> dict[str, Any]:
        asked.append(excluded)
        if len(asked) == 3:
            raise KeyboardInterrupt
        return guess(files, excluded)

    monkeypatch.setitem(collect.ANSWERERS, "workflow", counted)
    store = collect.Store(tmp_path)
    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        collect.run(wanted, store, ["workflow"], pool, 1)
    assert len(list((tmp_path / "workflow").iterdir())) == 2
    fractions: list[float] = []
    with ThreadPoolExecutor(1) as pool:
        collect.run(wanted, store, ["workflow"], pool, 1, fractions.append)
    assert len(asked) == len(wanted) + 1
    assert fractions[-1] == 1.0
    assert not list(tmp_path.rglob("*.part"))

    text = report.write(tmp_path, len(wanted))
    found = json.loads((tmp_path / "report.json").read_text())
    seen = next(goal for goal in found["goals"] if goal["name"] == "clear and strong: named first")
    assert (seen["hits"], seen["of"], seen["reached"]) == (2, 4, False)
    assert found["confusion"]["constant_bias"] == {"stribeck": 2}
    assert found["confusion"]["none"] == {"stribeck": 2}
    assert "NOT REACHED" in text
    assert (tmp_path / "confusion.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_an_error_of_the_workflow_is_an_answer(tmp_path: Path) -> None:
    def broken(folder: Path) -> dict[str, Any]:
        raise RuntimeError(f"cannot read {folder.name}")

    found = tasks.timed(broken, {"model.yaml": b"{}"})
    assert "cannot read gap-" in found["error"]
    assert found["wall_s"] >= 0.0


def test_options_choose_the_cases() -> None:
    options = command.parse(["--only", "stribeck", "--kind", "single", "--strength", "clear", "--seeds", "2"])
    chosen = command.chosen(options)
    assert [(case.slugs, case.strength) for case in chosen] == [(("stribeck",), "clear")] * 2
    assert len(command.chosen(command.parse(["--quick", "--most", "5"]))) == 5
    with pytest.raises(SystemExit):
        command.parse(["--only", "stribek"])


def test_without_answers_there_is_no_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["-o", str(tmp_path), "--report"]) == 1
    assert "has no answers" in capsys.readouterr().err
