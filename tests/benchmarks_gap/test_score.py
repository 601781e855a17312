"""Scoring on hand-made answers: every outcome, rates, coverage, goals."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.gap import score, summary
from benchmarks.gap.score import Rate
from benchmarks.gap.summary import Scored


def answer(verdict: str, *effects: str, ties: tuple[str, ...] = (), parameters: dict[str, Any] | None = None) -> Any:
    steps = [
        {"effect": effect, "parameters": parameters or {}, "indistinguishable_from": list(ties if not index else ())}
        for index, effect in enumerate(effects)
    ]
    gap = {"held_out": {"before": 3.0, "after": 1.1}}
    return {
        "verdict": verdict,
        "effects": list(effects),
        "steps": steps,
        "gap": gap,
        "wall_s": 2.0,
        "peak_memory_MB": 1,
    }


def truth(*effects: dict[str, Any], kind: str = "single", strength: str = "clear") -> dict[str, Any]:
    slugs = [effect["name"] for effect in effects]
    return {
        "name": "x", "kind": kind, "strength": strength, "slugs": slugs, "effects": list(effects), "visibility": 1.5,
        "coulomb": 2e-3, "device": "re35",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("hidden", "given", "expected"),
    [
        ("stribeck", answer("effect_found", "stribeck"), "right"),
        ("stribeck", answer("effect_found", "stribeck", "gravity"), "right"),
        ("stribeck", answer("effect_found", "gravity", "stribeck"), "wrong"),
        ("stribeck", answer("effect_found", "quadratic_drag"), "wrong"),
        ("stribeck", answer("effect_found", "quadratic_drag", ties=("stribeck",)), "wrong"),
        ("asymmetric_coulomb", answer("effect_found", "constant_bias", ties=("asymmetric_coulomb",)), "right"),
        ("asymmetric_coulomb", answer("effect_found", "constant_bias"), "wrong"),
        ("stribeck", answer("ambiguous", "quadratic_drag", ties=("stribeck",)), "right"),
        ("stribeck", answer("ambiguous", "stribeck", ties=("gravity",)), "vague"),
        ("stribeck", answer("ambiguous", "quadratic_drag", ties=("presliding",)), "vague"),
        ("stribeck", answer("no_missing_effect"), "missed"),
        ("stribeck", answer("unexplained", "stribeck"), "unexplained"),
        ("stribeck", {"error": "Traceback"}, "failed"),
    ],
)
def test_outcome(hidden: str, given: dict[str, Any], expected: str) -> None:
    assert score.outcome(given, hidden) == expected


def test_both_of_a_pair_must_be_named() -> None:
    pair = ["stribeck", "constant_bias"]
    assert score.both_named(answer("effect_found", "constant_bias", "stribeck"), pair)
    assert not score.both_named(answer("effect_found", "constant_bias", "gravity"), pair)
    assert not score.both_named(answer("unexplained", "constant_bias", "stribeck"), pair)
    assert score.both_named(answer("ambiguous", "constant_bias", "quadratic_drag", "stribeck"), pair)
    assert not score.both_named(answer("ambiguous", "constant_bias", "backlash", "torque_ripple", "stribeck"), pair)
    class_member = answer("effect_found", "asymmetric_coulomb", "stribeck", ties=("constant_bias",))
    assert score.both_named(class_member, pair)


def test_only_a_sure_and_wrong_first_name_is_confidently_wrong() -> None:
    assert score.confident_wrong(answer("effect_found", "gravity"), ["stribeck"])
    assert not score.confident_wrong(answer("effect_found", "stribeck", "gravity"), ["gravity", "stribeck"])
    assert not score.confident_wrong(answer("ambiguous", "gravity"), ["stribeck"])
    assert not score.confident_wrong(answer("unexplained", "gravity"), ["stribeck"])


def test_wilson_interval_of_a_published_example() -> None:
    # Newcombe 1998, Table I: 81 of 263 gives 0.2553 to 0.3662.
    low, high = Rate(81, 263).interval
    assert (low, high) == (pytest.approx(0.2553, abs=5e-5), pytest.approx(0.3662, abs=5e-5))
    assert Rate(0, 20).interval[0] == 0.0
    assert Rate(0, 20).interval[1] == pytest.approx(0.1611, abs=5e-5)


def _estimate(low: float, high: float) -> dict[str, Any]:
    return {"value": 0.5 * (low + high), "ci95": [low, high], "unit": ""}


def test_parameters_inside_their_intervals() -> None:
    hidden = truth({"name": "stribeck", "s": 0.4, "omega_s": 3.0})
    given = answer("effect_found", "stribeck", parameters={"s": _estimate(0.3, 0.5), "omega_s": _estimate(3.1, 4.0)})
    assert dict(score.inside(given, hidden)) == {"s": True, "omega_s": False}
    scored = [Scored(hidden, given)]
    assert summary.coverage(scored, sizes_only=True) == Rate(1, 1)
    assert summary.coverage(scored, sizes_only=False) == Rate(1, 2)


def test_a_bias_stands_for_an_asymmetric_friction_with_its_sign() -> None:
    hidden = truth({"name": "asymmetric_coulomb", "a": 0.1})
    estimates = {"tau_0": _estimate(-2.1e-4, -1.9e-4)}
    given = answer("effect_found", "constant_bias", ties=("asymmetric_coulomb",), parameters=estimates)
    assert score.inside(given, hidden) == [("tau_0", True)]


def test_orders_of_a_ripple_are_matched_by_number() -> None:
    hidden = truth({"name": "torque_ripple", "orders": [7, 3], "amplitudes": [2e-4, 1e-4], "phases": [0, 0]})
    estimates = {
        "orders[0]": _estimate(2.99, 3.01),
        "orders[1]": _estimate(6.99, 7.02),
        "amplitudes[0]": _estimate(2e-4, 3e-4),
        "amplitudes[1]": _estimate(1.9e-4, 2.2e-4),
    }
    given = answer("effect_found", "torque_ripple", parameters=estimates)
    assert dict(score.inside(given, hidden)) == {"amplitude of order 7": True, "amplitude of order 3": False}


def test_goals_count_what_they_say() -> None:
    stribeck = {"name": "stribeck", "s": 0.4, "omega_s": 3.0}
    scored = [
        Scored(truth(stribeck), answer("effect_found", "stribeck", parameters={"s": _estimate(0.3, 0.5)})),
        Scored(truth(stribeck, strength="strong"), answer("effect_found", "gravity")),
        Scored(truth(stribeck, strength="barely"), answer("no_missing_effect")),
        Scored(truth(stribeck, strength="barely"), answer("effect_found", "gravity")),
        Scored(truth(kind="none", strength="none"), answer("no_missing_effect")),
        Scored(truth(kind="none", strength="none"), answer("unexplained")),
        Scored(truth(stribeck, kind="left_out"), answer("unexplained")),
        Scored(truth(stribeck, {"name": "gravity"}, kind="pair"), answer("effect_found", "gravity", "stribeck")),
    ]
    goals = {goal.name.strip(): goal for goal in summary.goals(scored)}
    assert goals["clear and strong: named first"].rate == Rate(1, 2)
    assert goals["clear and strong: named first"].reached is False
    assert goals["size inside its 95 % interval"].rate == Rate(1, 1)
    assert goals["held-out gap after ≤ 1.2"].rate == Rate(1, 1)
    assert goals["barely visible: confident wrong name"].rate == Rate(1, 2)
    assert goals["nothing hidden: false alarm"].rate == Rate(1, 2)
    assert goals["class left out: confident wrong name"].rate == Rate(0, 1)
    assert goals["class left out: confident wrong name"].reached is True
    assert goals["two hidden: both named"].rate == Rate(1, 1)
    assert summary.confusion(scored)["stribeck"] == {"stribeck": 1, "gravity": 1}
    assert [entry["verdict"] for entry in summary.wrong_cases(scored)] == [
        "effect_found",
        "effect_found",
        "unexplained",
    ]
