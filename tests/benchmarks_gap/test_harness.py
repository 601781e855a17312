"""The plan, the seal, going on after a stop, and the report, with a workflow that is made up."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.gap import __main__ as command
from benchmarks.gap import cases, collect, options, plan, report, tasks
from benchmarks.gap.collect import Asked
from benchmarks.gap.disturbance import Coloured
from benchmarks.gap.generate import Recording, UnstableError, generate
from benchmarks.gap.hidden import LAWS, Effect
from hapticd.config import load_config
from hapticd.record import read_run

SMALL = plan.Size(single=1, none=1, pair=0, wrong_base=1, left_out=1, duration_s=2.0)


def test_a_hundred_seeds_have_all_that_is_asked_for() -> None:
    drawn = plan.draw(plan.FULL, range(100))
    assert len({case.name for case in drawn}) == len(drawn)
    counts = Counter(case.kind for case in drawn)
    assert counts["single"] >= 300
    assert counts["none"] >= 300
    assert counts["pair"] >= 100
    assert counts["wrong_base"] >= 60
    assert counts["left_out"] >= 100
    for kind in plan.KINDS:
        mine = [case for case in drawn if case.kind == kind]
        assert sum(case.coloured is not None for case in mine) == len(mine) // 2
    single = Counter(case.slugs[0] for case in drawn if case.kind == "single")
    assert set(single) == set(LAWS)
    assert min(single.values()) >= 12
    strengths = [case.strengths[0] for case in drawn if case.strengths]
    assert 0.1 <= min(strengths) < 0.15
    assert 0.95 < max(strengths) <= 1.0
    assert {case.form for case in drawn} == {"csv", "parquet", "arrow"}
    assert len({case.device for case in drawn}) == 5
    assert {case.coloured for case in drawn} == {
        None,
        *(Coloured(s, t) for s in (0.05, 0.25) for t in (0.01, 0.05, 0.2)),
    }


def test_a_seed_makes_the_same_cases_whatever_else_is_asked_for() -> None:
    assert plan.draw(plan.FULL, [7]) == [case for case in plan.draw(plan.FULL, range(10)) if case.seed == 7]
    assert not {case.name for case in plan.draw(plan.FULL, [7])} & {case.name for case in plan.draw(plan.FULL, [8])}


def test_a_wrong_base_parameter_is_none_of_the_effect_itself() -> None:
    for case in plan.draw(plan.Size(single=0, none=0, pair=0, left_out=0), range(60)):
        assert case.slugs[1] in plan.BASE_ERRORS
        assert case.slugs[0] != case.slugs[1]
        assert len(case.strengths) == 1


def test_what_is_left_out_is_the_whole_exact_class() -> None:
    case = plan.Case("left_out", ("constant_bias",), (0.5,), 1, 0, "re35", "csv", 20.0)
    assert case.excluded == ("asymmetric_coulomb", "constant_bias")
    assert replace(case, kind="single").excluded == ()


@pytest.mark.parametrize("form", cases.FORMS)
def test_the_workflow_gets_a_readable_run_and_the_nominal_model_and_nothing_else(form: str, tmp_path: Path) -> None:
    case = plan.Case("single", ("coulomb_friction",), (1.0,), 5, 0, "re35", form, 2.0, Coloured(0.05, 0.05))
    files, truth = tasks.make(case)
    assert set(files) == {f"run.{form}", "model.yaml"}
    assert abs(truth["effects"][0]["r"]) == 0.5
    assert truth["coulomb"] == pytest.approx(2e-3 * (1.0 + truth["effects"][0]["r"]))
    assert truth["visibility"][0] > 3.0
    assert truth["visibility_of_coloured"] > 0.1
    for content in files.values():
        assert b"coulomb_friction" not in content
        assert b"visibility" not in content
        assert b"coloured" not in content
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
    ends = {"effects": ["stribeck"], "steps": []} if not excluded else {"effects": [], "steps": []}
    spent = {"wall_s": 0.1, "processor_s": 0.1, "peak_memory_MB": 1.0}
    return {"verdict": "effect_found" if not excluded else "unexplained", **ends, **spent}


def test_it_goes_on_where_it_was_stopped_and_reports(tmp_path: Path) -> None:
    effects = (("stribeck", 0.5), ("constant_bias", 0.6))
    wanted = [
        plan.Case("single", (slug,), (strength,), 0, number, "re35", "csv", 2.0)
        for number, (slug, strength) in enumerate(effects)
    ]
    wanted += [plan.Case("none", (), (), 0, 2, "re35", "csv", 2.0, Coloured(0.05, 0.05))]
    wanted += [plan.Case("left_out", ("stribeck",), (0.5,), 0, 3, "re35", "csv", 2.0)]
    asked: list[Sequence[str]] = []
    stops = [False, False, True]

    def counted(files: dict[str, bytes], excluded: Sequence[str]) -> dict[str, Any]:
        asked.append(excluded)
        if stops and stops.pop(0):
            raise KeyboardInterrupt
        return guess(files, excluded)

    store = collect.Store(tmp_path)
    who = {"workflow": Asked(counted), "sindy": Asked(guess, most=1)}
    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        collect.run(wanted, store, who, pool, 1)
    assert len(list((tmp_path / "workflow").iterdir())) == 2
    asked.clear()
    fractions: list[float] = []
    with ThreadPoolExecutor(1) as pool:
        collect.run(wanted, store, who, pool, 1, fractions.append)
    assert len(asked) == len(wanted) - 2
    assert len(list((tmp_path / "sindy").iterdir())) == 1
    assert fractions[-1] == 1.0
    assert not list(tmp_path.rglob("*.part"))

    text = report.write(tmp_path, wanted)
    found = json.loads((tmp_path / "report.json").read_text())
    seen = next(goal for goal in found["goals"] if goal["name"].startswith("first name, strength ≥"))
    assert (seen["all"]["hits"], seen["all"]["of"], seen["all"]["reached"]) == (1, 2, False)
    assert seen["with coloured torque"]["reached"] is None
    assert found["confusion"]["constant_bias"] == {"stribeck": 1}
    assert found["confusion"]["none"] == {"stribeck": 1}
    assert found["sindy"]["cases"] == 1
    assert "NOT REACHED" in text
    assert "1 cases that hapticd and PySINDy were asked" in text
    for name in ("confusion.png", "confusion_sindy.png"):
        assert (tmp_path / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    with pytest.raises(FileNotFoundError):
        report.write(tmp_path, plan.draw(SMALL, [50]))


def test_an_error_of_the_workflow_is_an_answer() -> None:
    def broken(folder: Path) -> dict[str, Any]:
        raise RuntimeError(f"cannot read {folder.name}")

    found = tasks.timed(broken, {"model.yaml": b"{}"})
    assert "cannot read gap-" in found["error"]
    assert found["wall_s"] >= 0.0


def test_the_memory_of_a_case_is_its_own() -> None:
    def small(folder: Path) -> dict[str, Any]:
        return {}

    def large(folder: Path) -> dict[str, Any]:
        return {"sum": float(np.ones(25_000_000).sum())}

    before, during, after = (tasks.timed(answer, {})["peak_memory_MB"] for answer in (small, large, small))
    assert during > before + 150.0
    assert after < during - 150.0


def test_options_choose_the_cases() -> None:
    asked = command.parse(["--only", "stribeck", "--kind", "single", "--seed", "0:8"])
    assert [case.slugs for case in command.chosen_cases(asked)] == [("stribeck",)]
    assert len(command.chosen_cases(command.parse(["--most", "5"]))) == 5
    assert {case.seed for case in command.chosen_cases(command.parse(["--quick"]))} == {0}
    assert {case.seed for case in command.chosen_cases(command.parse(["--seed", "100:102"]))} == {100, 101}
    with pytest.raises(SystemExit):
        command.parse(["--only", "stribek"])


def test_seeds_to_develop_on_and_reported_ones_are_not_mixed() -> None:
    assert options.seeds("0:100") == range(100)
    assert options.seeds("100:200") == range(100, 200)
    assert options.seeds("7") == range(7, 8)
    for wrong in ("90:110", "5:5", "x", "-1:3"):
        with pytest.raises(argparse.ArgumentTypeError):
            options.seeds(wrong)


def test_without_answers_there_is_no_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["-o", str(tmp_path), "--report"]) == 1
    assert "has no answers" in capsys.readouterr().err


def test_a_session_that_is_too_much_for_the_device_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    sessions = []

    def first_fails(effects: Sequence[Effect], seed: int, *more: Any, **named: Any) -> Recording:
        sessions.append(seed)
        if len(sessions) == 1:
            raise UnstableError("too fast")
        return generate(effects, seed, *more, **named)

    monkeypatch.setattr(tasks, "generate", first_fails)
    case = plan.Case("wrong_base", ("constant_bias", "inertia_error"), (0.5,), 5, 0, "re35", "csv", 2.0)
    truth = tasks.make(case)[1]
    assert truth["draws"] == len(set(sessions)) == 2
    assert [effect["name"] for effect in truth["effects"]] == ["constant_bias", "inertia_error"]
    assert len(truth["visibility"]) == 2
