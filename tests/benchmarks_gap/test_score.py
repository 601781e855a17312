"""Scoring on hand-made answers: every outcome, rates, coverage, goals."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.gap import coverage, score, summary
from benchmarks.gap.rate import Rate
from benchmarks.gap.summary import Goal, Rates, Scored


def answer(verdict: str, *effects: str, ties: tuple[str, ...] = (), parameters: dict[str, Any] | None = None) -> Any:
    steps = [
        {"effect": effect, "parameters": parameters or {}, "indistinguishable_from": list(ties if not index else ())}
        for index, effect in enumerate(effects)
    ]
    return {
        "verdict": verdict,
        "effects": list(effects),
        "steps": steps,
        "wall_s": 2.0,
        "processor_s": 1.9,
        "peak_memory_MB": 1.0,
    }


def truth(
    *effects: dict[str, Any], kind: str = "single", strength: float = 0.5, coloured: dict[str, float] | None = None
) -> dict[str, Any]:
    slugs = [effect["name"] for effect in effects]
    return {
        "name": "x", "kind": kind, "strengths": [strength] * len(effects), "slugs": slugs, "effects": list(effects),
        "visibility": [1.5] * len(effects), "coulomb": 2e-3, "device": "re35", "seed": 0, "number": 0,
        "coloured": coloured,
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
        ("stribeck", answer("partly_explained", "stribeck"), "right"),
        ("stribeck", answer("partly_explained", "gravity", "stribeck"), "partly"),
        ("stribeck", answer("ambiguous", "quadratic_drag", ties=("stribeck",)), "tied"),
        ("stribeck", answer("ambiguous", "stribeck", ties=("gravity",)), "tied"),
        ("stribeck", answer("ambiguous", "gravity", ties=("stribeck",)), "vague"),
        ("stribeck", answer("ambiguous", "quadratic_drag", ties=("presliding",)), "vague"),
        ("stribeck", answer("no_missing_effect"), "missed"),
        ("stribeck", answer("unexplained", "stribeck"), "unexplained"),
        ("stribeck", {"error": "Traceback"}, "failed"),
        ("stribeck", {"late": "no answer in 300 s"}, "late"),
    ],
)
def test_outcome(hidden: str, given: dict[str, Any], expected: str) -> None:
    assert score.outcome(given, [hidden]) == expected
    assert score.is_named(given, [hidden]) == (expected in ("right", "tied"))


def test_both_of_a_pair_must_be_named() -> None:
    pair = ["stribeck", "constant_bias"]
    assert score.all_named(answer("effect_found", "constant_bias", "stribeck"), pair)
    assert score.all_named(answer("partly_explained", "constant_bias", "stribeck"), pair)
    assert not score.all_named(answer("effect_found", "constant_bias", "gravity"), pair)
    assert not score.all_named(answer("unexplained", "constant_bias", "stribeck"), pair)
    assert score.all_named(answer("ambiguous", "constant_bias", "quadratic_drag", ties=("stribeck",)), pair)
    class_member = answer("effect_found", "asymmetric_coulomb", "stribeck", ties=("constant_bias",))
    assert score.all_named(class_member, pair)


def test_only_a_sure_and_wrong_first_name_is_confidently_wrong() -> None:
    assert score.confident_wrong(answer("effect_found", "gravity"), ["stribeck"])
    assert not score.confident_wrong(answer("effect_found", "stribeck", "gravity"), ["gravity", "stribeck"])
    for verdict in ("ambiguous", "unexplained", "partly_explained"):
        assert not score.confident_wrong(answer(verdict, "gravity"), ["stribeck"])


def test_three_wrong_base_parameters_are_the_fourth() -> None:
    three = ("coulomb_friction", "viscous_friction", "torque_constant_error")
    assert not score.confident_wrong(answer("effect_found", *three), ["inertia_error"])
    assert score.confident_wrong(answer("effect_found", *three[:2]), ["inertia_error"])
    assert score.confident_wrong(answer("effect_found", *three), ["stribeck"])


def test_wrong_further_names_are_those_after_the_first_that_are_not_hidden() -> None:
    hidden = ["stribeck", "constant_bias"]
    assert score.wrong_further(answer("effect_found", "stribeck", "gravity", "constant_bias"), hidden) == ["gravity"]
    assert score.wrong_further(answer("effect_found", "gravity", "stribeck"), hidden) == []
    assert score.wrong_further({"error": "x"}, hidden) == []


def test_wilson_interval_of_a_published_example() -> None:
    # Newcombe 1998, Table I: 81 of 263 gives 0.2553 to 0.3662.
    low, high = Rate(81, 263).interval
    assert (low, high) == (pytest.approx(0.2553, abs=5e-5), pytest.approx(0.3662, abs=5e-5))
    assert Rate(0, 20).interval[0] == 0.0
    assert Rate(0, 20).interval[1] == pytest.approx(0.1611, abs=5e-5)


def estimate(low: float, high: float) -> dict[str, Any]:
    return {"value": 0.5 * (low + high), "ci95": [low, high], "unit": ""}


def test_parameters_inside_their_intervals() -> None:
    hidden = truth({"name": "stribeck", "s": 0.4, "omega_s": 3.0})
    given = answer("effect_found", "stribeck", parameters={"s": estimate(0.3, 0.5), "omega_s": estimate(3.1, 4.0)})
    assert dict(coverage.inside(given, hidden)) == {"stribeck: s": True, "stribeck: omega_s": False}
    assert summary.coverage([Scored(hidden, given)]) == Rate(1, 2)
    unknown = answer("effect_found", "stribeck", parameters={"s": {"value": 0.4, "ci95": [None, 0.5], "unit": ""}})
    assert coverage.inside(unknown, hidden) == []


def test_a_bias_stands_for_an_asymmetric_friction_with_its_sign() -> None:
    hidden = truth({"name": "asymmetric_coulomb", "a": 0.1})
    estimates = {"tau_0": estimate(-2.1e-4, -1.9e-4)}
    given = answer("effect_found", "constant_bias", ties=("asymmetric_coulomb",), parameters=estimates)
    assert coverage.inside(given, hidden) == [("asymmetric_coulomb: tau_0", True)]


def test_an_angle_may_be_a_turn_away() -> None:
    hidden = truth({"name": "gravity", "m_g_l": 1e-3, "theta_0": -3.1})
    estimates = {"m_g_l": estimate(0.9e-3, 1.1e-3), "theta_0": estimate(3.1, 3.3)}
    given = answer("effect_found", "gravity", parameters=estimates)
    assert dict(coverage.inside(given, hidden)) == {"gravity: m_g_l": True, "gravity: theta_0": True}


def test_orders_of_a_ripple_are_matched_by_number() -> None:
    hidden = truth({"name": "torque_ripple", "orders": [7, 3], "amplitudes": [2e-4, 1e-4], "phases": [0, 0]})
    estimates = {
        "orders[0]": estimate(2.99, 3.01),
        "orders[1]": estimate(6.99, 7.02),
        "amplitudes[0]": estimate(2e-4, 3e-4),
        "amplitudes[1]": estimate(1.9e-4, 2.2e-4),
    }
    given = answer("effect_found", "torque_ripple", parameters=estimates)
    assert dict(coverage.inside(given, hidden)) == {
        "torque_ripple: amplitude of order 7": True,
        "torque_ripple: amplitude of order 3": False,
    }


def test_goals_count_what_they_say_with_and_without_coloured_torque() -> None:
    stribeck = {"name": "stribeck", "s": 0.4, "omega_s": 3.0}
    loud = {"share": 0.25, "correlation_s": 0.05}
    scored = [
        Scored(truth(stribeck), answer("effect_found", "stribeck", parameters={"s": estimate(0.3, 0.5)})),
        Scored(truth(stribeck, coloured=loud), answer("effect_found", "gravity", "torque_ripple")),
        Scored(truth(stribeck, strength=0.2), answer("no_missing_effect")),
        Scored(truth(stribeck, strength=0.2), answer("effect_found", "gravity")),
        Scored(truth(kind="none"), answer("no_missing_effect")),
        Scored(truth(kind="none", coloured=loud), answer("unexplained")),
        Scored(truth(stribeck, kind="left_out"), answer("partly_explained", "gravity")),
        Scored(
            truth(stribeck, {"name": "gravity", "m_g_l": 1e-3, "theta_0": 0.0}, kind="pair"),
            answer("effect_found", "gravity", "stribeck"),
        ),
    ]
    goals = {goal.name: goal for goal in summary.goals(scored)}
    first = goals["first name, strength ≥ 0.3"]
    assert first.rates == Rates(Rate(1, 2), Rate(1, 1), Rate(0, 1))
    assert first.reached == [False, True, False]
    assert goals["first name, strength < 0.3"].rates.everything == Rate(0, 2)
    assert goals["wrong further names, one hidden"].rates == Rates(Rate(1, 4), Rate(0, 3), Rate(1, 1))
    alarms = goals["false alarms, nothing hidden"]
    assert alarms.rates == Rates(Rate(1, 2), Rate(0, 1), Rate(1, 1))
    assert alarms.reached == [None, True, False]
    assert goals["left-out class: confidently wrong"].reached == [True, True, None]
    assert goals["inside the 95 % intervals"].rates.everything == Rate(1, 1)
    assert goals["two hidden: both named"].rates.everything == Rate(1, 1)
    bands = {goal.name: goal.rates.everything for goal in summary.by_visibility(scored)}
    assert bands["visibility 1 to 3"] == Rate(1, 4)
    assert summary.by_torque(scored) == {"none": Rate(1, 1), "25 % of the friction, 50 ms": Rate(0, 1)}
    assert summary.confusion(scored)["stribeck"] == {"stribeck": 1, "gravity": 1}
    assert [entry["verdict"] for entry in summary.wrong_cases(scored)] == [
        "effect_found",
        "effect_found",
        "unexplained",
    ]


def test_a_goal_with_two_bounds() -> None:
    rates = Rates(Rate(99, 100), Rate(95, 100), Rate(0, 0))
    assert Goal("x", rates, ((0.9, 0.98),) * 3).reached == [False, True, None]
