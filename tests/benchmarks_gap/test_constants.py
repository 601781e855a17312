"""The trial of the workflow's constants: which there are, what they become, and that they are put back."""

from __future__ import annotations

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.gap import constants, options, plan, tasks
from benchmarks.gap.constants import changed, numbers, variants

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    made = ModuleType(constants.MODULE)
    vars(made).update({"LEVEL": 0.5, "MOST": 3, "ONCE": True, "WORDS": "x", "lower": 1.0, "_HIDDEN": 2.0})
    monkeypatch.setitem(sys.modules, constants.MODULE, made)
    return made


def test_the_constants_are_the_numbers_in_capitals(module: ModuleType) -> None:
    assert numbers(module) == {"LEVEL": 0.5, "MOST": 3}
    tried = variants(numbers(module))
    assert [one.values for one in tried] == [{}, {"LEVEL": 0.35}, {"LEVEL": 0.7}, {"MOST": 2}, {"MOST": 5}]
    assert len({one.folder for one in tried}) == len(tried)


@pytest.mark.parametrize(("value", "lower", "upper"), [(10, 7, 14), (1, 1, 2), (0.2, 0.14, 0.28), (-1.0, -0.7, -1.4)])
def test_whole_numbers_stay_whole(value: float, lower: float, upper: float) -> None:
    assert changed(value, 0.7) == pytest.approx(lower)
    assert changed(value, 1.4) == pytest.approx(upper)
    assert type(changed(value, 1.4)) is type(value)


def test_they_are_put_back(module: ModuleType) -> None:
    with tasks.changed_constants({"LEVEL": 9.0}):
        assert module.LEVEL == 9.0
    assert module.LEVEL == 0.5


def test_without_the_module_it_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(constants, "MODULE", "hapticd.gap.no_such_constants")
    assert constants.main([]) == 2
    assert "no module hapticd.gap.no_such_constants" in capsys.readouterr().err


def test_the_table_has_a_line_for_every_value(
    module: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def find(folder: Path, excluded: Any, values: Any) -> dict[str, Any]:
        with tasks.changed_constants(values or {}):
            return {"verdict": "effect_found" if module.LEVEL > 0.6 else "no_missing_effect", "effects": ["gravity"]}

    @contextmanager
    def threads(chosen: Any) -> Iterator[ThreadPoolExecutor]:
        with ThreadPoolExecutor(1) as pool:
            yield pool

    monkeypatch.setattr(tasks, "find", find)
    monkeypatch.setattr(options, "engine", threads)
    one_null = plan.Size(single=0, none=1, pair=0, wrong_base=0, left_out=0, duration_s=2.0)
    monkeypatch.setattr(constants, "SMALL", one_null)
    assert constants.main(["-o", str(tmp_path), "--seed", "3"]) == 0
    lines = {line[:18].strip(): line for line in capsys.readouterr().out.splitlines()}
    assert "0.0 % (0/1" in lines["as it is"].split("- ")[2]
    assert "100.0 % (1/1" in lines["LEVEL = 0.5 × 1.4"]
    assert "100.0 % (1/1" not in lines["LEVEL = 0.5 × 0.7"]
    rows = json.loads((tmp_path / "constants.json").read_text())
    changed_answers = {label: row["another answer"]["hits"] for label, row in rows.items()}
    assert [changed_answers[label] for label in ("as it is", "LEVEL = 0.5 × 0.7", "LEVEL = 0.5 × 1.4")] == [0, 0, 1]
