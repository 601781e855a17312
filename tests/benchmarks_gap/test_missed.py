"""The benchmark of what was missed: which cases it takes, and what it says of an effect fitted from the truth on."""

from __future__ import annotations

from typing import Any

from benchmarks.gap import tasks
from benchmarks.gap.missed import Known, Missed, is_missed, known, row
from benchmarks.gap.plan import Case
from benchmarks.gap.summary import Scored


def scored(slugs: list[str], effects: list[str], verdict: str = "effect_found") -> Scored:
    truth: dict[str, Any] = {"slugs": slugs, "strengths": [0.5], "seed": 3, "number": 1, "coloured": None}
    return Scored(truth, {"verdict": verdict, "effects": effects, "steps": []})


def test_a_case_is_missed_as_long_as_a_hidden_effect_has_no_name() -> None:
    assert not is_missed(scored(["stribeck"], ["stribeck"]))
    assert is_missed(scored(["stribeck"], [], "no_missing_effect"))
    assert is_missed(scored(["stribeck", "inertia_error"], ["stribeck"]))
    assert not is_missed(scored(["stribeck", "inertia_error"], ["inertia_error", "stribeck"]))


def test_a_line_for_each_hidden_effect_says_whether_it_can_be_known() -> None:
    effects = [Known("stribeck", 9.0, 0.04, 8.0, 0.03), Known("inertia_error", 5.0, 0.2, 1.0, 0.01)]
    first, second = row(Missed(scored(["stribeck", "inertia_error"], ["stribeck"]), effects, 4.2))
    assert first[1:] == ["stribeck", "0.50", "", "effect_found: stribeck", "9.0", "4.0%", "8.0", "3.0%", ""]
    assert second[-1] == "cannot be known"


def test_a_strong_effect_shows_from_its_truth_on() -> None:
    files, truth = tasks.make(Case("single", ("gravity",), (0.9,), 7, 0, "re35", "parquet", 6.0))
    (found,), needed = known(files, truth["effects"])
    assert found.slug == "gravity"
    assert min(found.errors, found.errors_beside_slow) > needed
    assert min(found.closed, found.closed_beside_slow) > 0.5
