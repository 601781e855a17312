"""The test of what is left: silent on noise, loud on a missing effect, and silent again once it is in the model."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapticd.gap import find_gap, structure
from hapticd.gap.structure import LEVEL, Dependence, Structure, chance, units
from hapticd.gap.structure_scores import Scores

BIAS = {"name": "constant_bias", "tau_0": 1e-4}


def found(case: tuple[Any, Any], candidates: list[str]) -> dict[str, Any]:
    recording, model = case
    return dict(find_gap([recording], model, candidates=candidates, design=False).to_json())


def test_no_structure_is_seen_where_nothing_is_missing(hidden: Callable[..., Any]) -> None:
    result = found(hidden([], 21), [])
    assert result["verdict"] == "no_missing_effect"
    assert result["structure"] == []
    assert result["residual_structure"]["p_value"] > LEVEL
    assert "looks like noise" in result["residual_structure"]["words"]


def test_a_missing_force_is_seen_and_gone_once_it_is_in_the_model(hidden: Callable[..., Any]) -> None:
    case = hidden([BIAS], 22)
    before, after = found(case, []), found(case, ["constant_bias"])
    assert before["verdict"] == "unexplained"
    assert before["residual_structure"]["p_value"] <= LEVEL
    assert "depends on" in before["statement"]
    assert after["verdict"] == "effect_found"
    assert after["residual_structure"]["p_value"] > LEVEL


def test_a_force_along_the_position_is_found_there(hidden: Callable[..., Any]) -> None:
    result = found(hidden([{"name": "return_spring", "k_s": 2e-4, "theta_0": 0.0}], 23), [])
    tests = {test["coordinate"]: test for test in result["residual_structure"]["tests"]}
    assert tests["position"]["p_value"] <= LEVEL
    assert tests["position"]["share"] == max(
        tests[name]["share"] for name in ("position", "time", "direction", "speed")
    )


def _noise(rng: np.random.Generator, windows: int, columns: int) -> np.ndarray:
    """Values that agree within runs of five windows and differ in size from run to run."""
    runs = np.repeat(rng.normal(size=(windows // 5, columns)) * rng.exponential(size=(windows // 5, 1)), 5, axis=0)
    return np.asarray(runs + 0.3 * rng.normal(size=(windows, columns)))


def test_false_alarms_are_as_frequent_as_designed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(structure, "_FLIPS", 499)
    rng, unit = np.random.default_rng(5), np.arange(200) // 5
    smallest = []
    for _ in range(300):
        noise = _noise(rng, 200, 9)
        parts = [Scores(noise[:, :3], 0.0), Scores(noise[:, 3:8], 0.0), Scores(noise[:, 8:], 0.0, one_sided=True)]
        smallest.append(chance(parts, unit, rng).min())
    assert np.mean(np.array(smallest) <= 0.05) == pytest.approx(0.05, abs=0.035)
    assert np.mean(np.array(smallest) <= 0.5) == pytest.approx(0.5, abs=0.08)


def test_a_shift_in_one_of_many_scores_is_found() -> None:
    rng, unit = np.random.default_rng(6), np.arange(200) // 5
    noise = _noise(rng, 200, 9)
    noise[:, 4] += 1.0
    parts = [Scores(noise[:, :3], 0.0), Scores(noise[:, 3:8], 0.0), Scores(noise[:, 8:], 0.0, one_sided=True)]
    p_values = chance(parts, unit, rng)
    assert p_values[1] <= LEVEL
    assert min(p_values[0], p_values[2]) > LEVEL


def test_few_blocks_are_parted_and_many_are_kept() -> None:
    assert units(np.arange(60) // 6).tolist() == (np.arange(60) // 3).tolist()
    assert units(np.arange(60) // 2).tolist() == (np.arange(60) // 2).tolist()
    assert units(np.array([0, 0, 1, 1])).tolist() == [0, 1, 2, 3]


def test_what_is_sure_but_small_does_not_matter() -> None:
    small, large = (Dependence("position", 1e-4, share, ", most between 0 and 1 rad") for share in (0.02, 0.2))
    assert not small.matters
    assert large.matters
    assert "too little to matter" in Structure((small,), 20).words
    assert Structure((large, small), 20).left == (large,)
    itself = Dependence("smooth", 1e-4, 0.4)
    assert Structure((itself, large), 20).left == (large, itself)
    assert large.words == (
        "What is left depends on position, which explains 20 % of it, most between 0 and 1 rad (p = 0.0001 in all tests "
        "together)."
    )


def test_a_test_that_sees_nothing_has_no_small_p_value() -> None:
    nothing = SimpleNamespace(values=np.zeros((40, 1)), statistic=Scores(np.zeros((40, 1)), 0.0).statistic)
    assert chance([nothing], np.arange(40), np.random.default_rng(1)).tolist() == [1.0]  # type: ignore[list-item]
