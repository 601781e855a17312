"""From the findings to one of five verdicts, with its sentence."""

from __future__ import annotations

import pytest

from hapticd.gap.result import GapNumbers, Remainder
from hapticd.gap.terms import term
from hapticd.gap.verdict import decide, doubts_about

GAP = GapNumbers(3e-4, 1e-5, 3.1e-4, 1.2e-5, 2e-6, "N m")
CLEAN = Remainder(0.002, "0.2 % of the missing force's power is left.", ())
LEFT = Remainder(
    0.3,
    "30 % of the missing force's power is left: a torque that depends on the position.",
    ({"coordinate": "position", "share": 0.3, "p_value": 1e-6},),
)


@pytest.mark.parametrize(
    ("effects", "indistinguishable", "remainder", "verdict"),
    [
        ([], [], CLEAN, "no_missing_effect"),
        ([], [], LEFT, "unexplained"),
        (["gravity"], [()], CLEAN, "effect_found"),
        (["gravity"], [()], LEFT, "partly_explained"),
        (["gravity"], [("constant_bias",)], CLEAN, "ambiguous"),
        (["gravity"], [("constant_bias",)], LEFT, "ambiguous"),
        (["stribeck", "gravity"], [(), ()], CLEAN, "effect_found"),
        (["stribeck", "gravity"], [(), ("constant_bias",)], CLEAN, "ambiguous"),
    ],
)
def test_the_verdict(
    effects: list[str], indistinguishable: list[tuple[str, ...]], remainder: Remainder, verdict: str
) -> None:
    found, statement = decide(effects, indistinguishable, [], GAP, remainder, 1.0)
    assert found == verdict
    assert statement.endswith(".")
    for effect in effects if verdict != "ambiguous" else []:
        assert effect in statement


@pytest.mark.parametrize(("share_left", "verdict"), [(0.35, "partly_explained"), (0.25, "effect_found")])
def test_an_answer_that_closes_less_than_seven_tenths_is_not_the_whole(share_left: float, verdict: str) -> None:
    numbers = GapNumbers(3e-4, 2e-4, 3.1e-4, 3.1e-4 * share_left**0.5, 2e-6, "N m")
    assert decide(["gravity"], [()], [], numbers, CLEAN, 1.0)[0] == verdict


def test_numbers_before_and_after_are_said() -> None:
    _, statement = decide(["stribeck", "gravity"], [(), ()], [], GAP, CLEAN, 1.0)
    assert statement == "Missing: stribeck and gravity (missing 0.00031 N m before, 1.2e-05 N m after)."


def test_what_is_indistinguishable_is_said() -> None:
    _, statement = decide(["gravity"], [("constant_bias", "return_spring")], [], GAP, CLEAN, 1.0)
    assert "gravity or constant_bias or return_spring" in statement
    assert "do not distinguish which it is" in statement


def test_what_is_sure_is_said_beside_a_tie() -> None:
    _, statement = decide(["inertia_error", "stribeck"], [(), ("viscous_friction",)], [], GAP, CLEAN, 1.0)
    assert statement.startswith(
        "Missing: inertia_error. These data do not distinguish which it is besides: stribeck or viscous_"
    )


def test_what_was_not_asked_for_is_not_denied() -> None:
    _, statement = decide([], [], [], GAP, LEFT, 1.0, are_all=False)
    assert "none of the effects that were asked for explains" in statement
    assert "no effect of the catalogue explains" in decide([], [], [], GAP, LEFT, 1.0)[1]


def test_doubts_and_what_is_left_are_said_beside_a_tie_too() -> None:
    _, statement = decide(["gravity"], [("constant_bias",)], ["It may be another law."], GAP, LEFT, 1.0)
    assert "It may be another law." in statement
    assert LEFT.words in statement


def test_a_tie_without_doubts_says_only_the_choice() -> None:
    _, statement = decide(["gravity", "stribeck"], [("return_spring",), ("presliding",)], [], GAP, CLEAN, 1.0)
    assert statement == (
        "These data do not distinguish which it is: gravity or return_spring; stribeck or presliding "
        "(missing 0.00031 N m before, 1.2e-05 N m after)."
    )


def test_structure_below_twice_the_noise_floor_does_not_matter() -> None:
    numbers = GapNumbers(3e-4, 1e-5, 3.1e-4, 3.9e-6, 2e-6, "N m")
    assert decide(["gravity"], [()], [], numbers, LEFT, 1.0)[0] == "effect_found"
    above = GapNumbers(3e-4, 1e-5, 3.1e-4, 4.1e-6, 2e-6, "N m")
    assert decide(["gravity"], [()], [], above, LEFT, 1.0)[0] == "partly_explained"


def test_what_is_left_is_said() -> None:
    for effects, indistinguishable in (([], []), (["gravity"], [()])):
        assert LEFT.words in decide(effects, indistinguishable, [], GAP, LEFT, 1.0)[1]


@pytest.mark.parametrize(
    ("at_bounds", "unnamed", "words"),
    [
        ({"gravity": ["theta_0"]}, {}, "do not distinguish theta_0 of gravity from a limit"),
        (
            {},
            {"gravity": "position"},
            "gravity is not named: it predicts worse than an unnamed function of the position.",
        ),
    ],
)
def test_a_doubt_makes_it_a_part_of_the_answer(
    at_bounds: dict[str, list[str]], unnamed: dict[str, str], words: str
) -> None:
    doubts = doubts_about(at_bounds, unnamed)
    assert len(doubts) == 1
    verdict, statement = decide(["gravity"], [()], doubts, GAP, CLEAN, 1.0)
    assert verdict == "partly_explained"
    assert words in statement
    assert decide(["gravity"], [("constant_bias",)], doubts, GAP, CLEAN, 1.0)[0] == "ambiguous"


def test_an_interval_that_reaches_the_end_of_a_range_does_not_tell_the_law_from_its_limit() -> None:
    hand = term("hand_impedance", {"m_h": 1e-6, "b_h": 1e-4}, (), 0.1)
    least, damping = hand.coordinates[0].lower, hand.start[1]
    assert hand.at_bounds(hand.start) == []
    assert hand.at_bounds((least, damping)) == ["m_h"]
    assert hand.at_bounds((least + 1.0, damping), (0.9, 0.1)) == []
    assert hand.at_bounds((least + 1.0, damping), (1.1, 0.1)) == ["m_h"]


def test_without_a_reason_there_is_no_doubt() -> None:
    assert doubts_about({}, {}) == []


def test_nothing_missing_names_the_noise_floor() -> None:
    _, statement = decide([], [], [], GAP, CLEAN, 1.0)
    assert "No effect is missing" in statement
    assert "2e-06 N m" in statement


def test_a_play_without_rebound_is_no_other_law() -> None:
    play = term("backlash", {"gap": 0.01, "load_share": 0.3, "restitution": 0.0}, (), 0.1)
    gap, load_share, _ = play.start
    assert play.at_bounds(play.start) == []
    assert play.at_bounds(play.start, (0.1, 0.1, 0.2)) == []
    assert play.at_bounds((gap, load_share, 0.95)) == ["restitution"]
    assert play.at_bounds((gap, play.coordinates[1].lower, 0.0)) == ["load_share"]


def test_more_missing_than_the_device_makes_is_said() -> None:
    found, statement = decide([], [], [], GAP, CLEAN, torque=1e-5)
    assert found == "unexplained"
    assert "More force is missing (1.2e-05 N m) than the device's friction and current make (1e-05 N m)" in statement
    assert decide([], [], [], GAP, CLEAN, torque=1e-4)[0] != "unexplained"


def test_a_structure_of_next_to_nothing_is_no_reason_to_call_an_answer_a_part() -> None:
    """Five exact numbers with less than 0.01 % of the power left had been explained in part."""
    tiny = Remainder(
        1e-4, "0.01 % is left: a torque that depends on the position.", ({**LEFT.structure[0], "share": 1e-4},)
    )
    assert decide(["gravity"], [()], [], GAP, tiny, 1.0)[0] == "effect_found"


def test_a_loud_force_without_structure_is_not_nothing() -> None:
    """A motor had half of its torque missing, and nothing was said to be missing."""
    loud = GapNumbers(2e-3, 2e-3, 2e-3, 2e-3, 2e-6, "N m")
    found, statement = decide([], [], [], loud, CLEAN, 4e-3)
    assert found == "unexplained"
    assert "missing force (0.002 N m) depends on no coordinate" in statement
    assert decide([], [], [], loud, CLEAN, 1e-2)[0] == "no_missing_effect"
