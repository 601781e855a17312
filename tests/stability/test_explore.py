"""Exploration: what was wrong before there was one, row by row; its starts and words; fresh loops and another simulator."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapticd.config import Config, apply_settings, load_config
from hapticd.servo.simulate import simulate
from hapticd.stability import explore as exploring
from hapticd.stability import sampled_loop
from hapticd.stability.assessment import assess
from hapticd.stability.cycles import UNDECIDED, answers_of
from hapticd.stability.explore import CHECK, GUARD, REMEDY, explore
from hapticd.stability.explored import Explored
from hapticd.stability.guard import explore_further, judge
from hapticd.stability.numbers import Dimensionless, Scales, loop_from_config, physical
from hapticd.stability.starts import starts_of
from hapticd.stability.theorems import proof_of
from hapticd.stability.whole_loop import record_of
from tests.stability.claims import CLASSES, draw, held_against
from tests.stability.independent import BUZZES, MOVES_ON, RESTS, runs, starts_within

IDEAL = {"amplifier.bandwidth_hz": 0, "amplifier.dac_bits": 0}
V = {
    "plant.inertia": 2.2365877592e-07,
    "plant.viscous": 8.2174760810e-07,
    "plant.coulomb": 4.7170410659e-06,
    "spring.damping": 1.6820216368e-04,
}
B = {"plant.inertia": 1.65564e-06, "plant.viscous": 6.756e-06, "plant.coulomb": 5.43029199e-08}
DM = {
    "plant.inertia": 1.2e-06,
    "plant.viscous": 7.92e-05,
    "plant.coulomb": 1.58325225e-05,
    "spring.damping": 7.2e-05,
    "spring.velocity_periods": 10,
}
D1 = {
    "plant.inertia": 1.2e-06,
    "plant.viscous": 9.6e-06,
    "plant.coulomb": 5.52233084e-06,
    "amplifier.dac_bits": 14,
    "amplifier.dac_full_scale": 2.556310,
}
D2 = {**D1, "plant.viscous": 6.24e-06, "plant.coulomb": 1.10446617e-05, "amplifier.dac_full_scale": 258.2131}
DITHER = {
    "plant.inertia": 1.2e-06,
    "plant.viscous": 9.6e-06,
    "plant.coulomb": 0.6 * 0.012 * 2.0 * math.pi / 8192,
    "dither.target": "position",
    "dither.amplitude": 3.0,
    "dither.frequency_hz": 50.0,
}
FP = {
    "plant.inertia": 1.2e-06,
    "plant.viscous": 1.236e-05,
    "plant.coulomb": 5.52233084e-06,
    "delay.computation_s": 0.5e-3,
    "spring.damping": 1e-12,
}
F = {
    "plant.inertia": 1.2e-06,
    "plant.viscous": 2.16e-05,
    "plant.coulomb": 5.52233084e-06,
    "delay.computation_s": 1.25e-3,
}


def config(values: dict[str, Any]) -> Config:
    return apply_settings(load_config(None), {**IDEAL, **values})


def oscillation(given: Config, duration_s: float, **motion: float) -> float:
    """Amplitude in ticks of what a run ends in, by the servo in virtual time."""
    truth: list[Any] = []
    simulate(given, duration_s, on_truth=lambda block: truth.append(block.copy()), **motion)
    last = np.concatenate(truth)[-2000:, 0] / given.resolution
    return float(0.5 * (last.max() - last.min()))


@pytest.mark.parametrize("motion", [{}, {"deflection": 5.5}])
def test_v_a_damper_that_shakes_for_ever_is_not_stable(motion: dict[str, float]) -> None:
    given = config(V)
    found = assess(given, **motion)
    assert (found.verdict, found.proven) == ("buzzes", False)
    assert found.explored is not None
    assert found.explored.buzzing > 0.05 * found.explored.starts
    said = judge(given, 0.0, **motion)
    assert said.verdict == "admitted"
    assert "end in a buzz of up to" in said.reason
    # what is left is as large as it says
    assert 0.0 < oscillation(given, 30.0, deflection=5.5) <= found.explored.largest_cycle + 1e-9


@pytest.mark.parametrize("motion", [{}, {"deflection": 26.0}])
def test_b_an_oscillation_of_18_ticks_is_refused(motion: dict[str, float]) -> None:
    given = config(B)
    found = assess(given, **motion)
    assert found.verdict == "buzzes"
    assert found.explored is not None
    assert found.explored.moving_on > 0
    assert found.explored.largest_cycle == pytest.approx(oscillation(given, 60.0, deflection=26.0), abs=0.5)
    said = judge(given, 0.0, **motion)
    assert said.verdict == "refused"
    assert "starts moved on" in said.reason


def test_dm_an_averaged_velocity_is_proven_but_for_its_first_periods() -> None:
    found = assess(config(DM), velocity=-0.02)
    assert found.verdict == "stable"
    assert not found.proven or "except in the first 10 periods" in judge(config(DM), 0.0, velocity=-0.02).reason


@pytest.mark.parametrize(("values", "velocity", "ticks"), [(D1, 1.0, 0.0), (D2, 20.0, 100.0)])
@pytest.mark.parametrize("asked", [True, False])
def test_d1_d2_what_a_converter_shakes_is_not_stable_and_refused_from_a_tick_on(
    values: dict[str, Any], velocity: float, ticks: float, asked: bool
) -> None:
    given, motion = config(values), {"velocity": velocity} if asked else {}
    found = assess(given, **motion)
    assert (found.verdict, found.proven) == ("buzzes", False)
    assert judge(given, 0.0, **motion).verdict == ("refused" if ticks else "admitted")
    assert found.explored is not None
    assert found.explored.largest_cycle > ticks
    assert oscillation(given, 20.0, velocity=velocity) > ticks


@pytest.mark.parametrize("motion", [{}, {"velocity": 1.0}])
def test_dither_that_friction_cannot_hold_is_not_stable(motion: dict[str, float]) -> None:
    found = assess(config(DITHER), **motion)
    assert (found.verdict, found.proven) == ("buzzes", False)
    assert judge(config(DITHER), 0.0, **motion).verdict == "admitted"
    assert found.explored is not None
    assert 0.0 < found.explored.largest_cycle < 1.0


def test_fp_below_lambda_nothing_is_called_passive() -> None:
    found = assess(config(FP))
    assert found.damped is not None
    assert not found.damped.passive
    assert not found.proven


def test_f_what_theorem_2_proves_is_admitted() -> None:
    for motion in ({}, {"deflection": 20.0}):
        found = assess(config(F), **motion)
        assert (found.verdict, found.proven, found.explored) == ("stable", True, None)
        assert judge(config(F), 0.0, **motion).verdict == "admitted"
    assert simulate(config(F), 5.0, deflection=20.0)["at_rest"]


def test_where_rest_is_impossible_nothing_decays() -> None:
    """The last row: μ 467.4, β 1.585, σ 0, τ_D 1, from −.41 ticks at −1.89 a period; it swings for ever."""
    loop = physical(Dimensionless(467.4, 1.585, 0.0, 1.0), Scales(0.012, config({}).resolution, 1e-3))
    given = config(
        {
            "plant.inertia": loop.inertia,
            "plant.viscous": loop.viscous,
            "plant.coulomb": 0.0,
            "delay.computation_s": loop.delay,
        }
    )
    for duration in (2.0, 5.0, 20.0):
        assert simulate(given, duration, deflection=-0.41, velocity=-1.89)["outcome"] in ("persistent", "growing")
    assert oscillation(given, 60.0, deflection=-0.41, velocity=-1.89) > 1.0
    assert judge(given, 0.0).verdict == "refused"


@pytest.mark.parametrize(
    ("values", "rests"),
    [
        ({"plant.coulomb": 4e-6}, False),
        ({"plant.coulomb": 5e-6}, True),
        ({"plant.coulomb": 4e-6, "spring.half_tick_bias": False}, True),
        ({"plant.coulomb": 0.0, "spring.side": "positive"}, True),
        ({"plant.coulomb": 0.0, "hand.stiffness": 0.01}, True),
        ({"plant.coulomb": 1e-6, "amplifier.dac_bits": 4, "amplifier.dac_full_scale": 0.1}, True),
        (
            {"plant.coulomb": 1e-5, "dither.target": "position", "dither.amplitude": 1.2, "dither.frequency_hz": 9},
            False,
        ),
    ],
)
def test_whether_there_is_a_place_to_rest(values: dict[str, Any], rests: bool) -> None:
    given = config(values)
    assert sampled_loop.can_rest(record_of(given, loop_from_config(given))[0]) == rests


@pytest.mark.parametrize(
    ("values", "motion"),
    [(B, {}), (B, {"deflection": 26.0}), (D2, {"velocity": 20.0}), ({**V, "spring.damping": 3e-3}, {})],
)
def test_the_start_that_is_shown_does_it_in_simulate_too(values: dict[str, Any], motion: dict[str, float]) -> None:
    given = config(values)
    found = assess(given, **motion).explored
    assert found is not None
    assert found.worst_start is not None
    assert "--deflection" in found.command(given.period) or "--velocity" in found.command(given.period)
    xi, xi_dot = found.worst_start
    duration = float(found.command(given.period).split()[-1])
    report = simulate(given, duration, deflection=xi, velocity=xi_dot)
    assert report["outcome"] in ("persistent", "growing")
    assert report["outcome"] == "growing" or oscillation(given, duration, deflection=xi, velocity=xi_dot) >= 1.0


def test_the_same_question_has_the_same_answer_in_any_number_of_threads() -> None:
    given = config(D2)
    answers = []
    for jobs in (1, 2, 3):
        exploring.explored_record.cache_clear()
        answers.append(explore(given, motion=(0.0, 20.0), effort=replace(CHECK, periods=300_000), jobs=jobs))
    assert answers[0] == answers[1] == answers[2]


def test_the_motion_is_the_first_start_and_no_other_has_more_energy() -> None:
    record = record_of(config(V), loop_from_config(config(V)))
    begun = starts_of(record, (5.5, 0.0), 5.5, math.inf, 0, 4096)
    assert (begun["xi"][0], begun["xi_dot"][0], begun["known"][0]) == (5.5, 0.0, False)
    size = np.hypot(begun["xi"], begun["xi_dot"] * math.sqrt(record["mu"][0]))
    assert size.max() <= 5.5 * (1.0 + 1e-9)
    # none of the strata is empty: slow and fast, each place in a tick, with and without memory
    assert np.histogram(np.log(size[1:]), bins=8, range=(math.log(0.2), math.log(5.5)))[0].min() > 50
    assert np.histogram(begun["xi"] % 1.0, bins=10, range=(0.0, 1.0))[0].min() > 100
    assert 0.2 < begun["known"].mean() < 0.8
    later = starts_of(record, (5.5, 0.0), 5.5, math.inf, 4096, 64)
    assert not np.isin(later["xi"], begun["xi"][begun["xi"] != 0.0]).any()


def test_words_and_bound() -> None:
    calm = Explored(4096, 4096, 0, 0, 0, 0, 900, 0.0, None, False, 0, False, None)
    assert calm.stable
    assert calm.words == "none of 4,096 starts moved on: fewer than 0.073 % do, with 95 % confidence"
    assert (1.0 - calm.bound) ** 4096 == pytest.approx(0.05)
    buzz = replace(calm, at_rest=4000, buzzing=96, largest_cycle=0.3)
    assert (buzz.stable, buzz.admissible) == (False, True)
    assert "96 end in a buzz of up to 0.3 ticks" in buzz.words
    moved = replace(calm, at_rest=4090, moving_on=5, undecided=1, largest_cycle=5.5)
    assert not moved.admissible
    assert moved.words == (
        "5 of 4,096 starts moved on, with up to 5.5 ticks; 1 of 4,096 starts were undecided after 900 periods"
    )
    assert set(moved.document) >= {"starts", "moving_on", "longest", "undecided", "largest_cycle"}


def test_what_is_undecided_is_refused() -> None:
    """A heavy mass that hardly anything brakes: no horizon of a judgement sees it stop."""
    given = config({"plant.inertia": 1e-3, "plant.viscous": 1e-9, "plant.coulomb": 4.5e-6, "spring.damping": 1e-7})
    said = judge(given, 0.0)
    assert said.verdict == "refused"
    assert "undecided" in said.reason or "moved on" in said.reason


def test_going_on_in_the_background_finds_what_the_first_starts_did_not() -> None:
    given = config({**V, "spring.damping": 3e-3})
    assert explore_further(config(F), 0.0) is None  # proven: nothing to do
    assert explore_further(config({"spring.stiffness": 0.0}), 0.0) is None
    first = explore_further(given, 0.0, skip=10_000)
    assert first is not None
    assert not first.admissible
    assert first.worst_start is not None
    calm = config({**V, "plant.coulomb": 2e-5, "spring.damping": 3e-5})
    skip, seen = 0, 0
    for _ in range(3):
        more = explore_further(calm, 0.0, skip=skip)
        assert more is not None
        assert more.admissible
        skip, seen = skip + more.starts, seen + more.at_rest
    assert skip >= 3 * GUARD.least
    assert seen > 0.99 * skip


def test_a_judgement_is_bounded_in_periods_and_not_in_time() -> None:
    for effort in (GUARD, REMEDY):
        found = explore(config(B), effort=replace(effort, until=None))
        most = 2 * effort.batch
        assert found.starts <= max(effort.least, effort.starts)
        assert found.longest <= effort.horizon
        assert found.starts >= effort.least or found.starts % most == 0


@pytest.mark.parametrize("kind", CLASSES)
def test_start_by_start_another_simulator_says_the_same(kind: str) -> None:
    """Every start without memory of a few loops of each class, run by both."""
    rng = np.random.default_rng(8)
    same = different = 0
    for question in draw(kind, 4, 31):
        given = question.config
        if given.dither.waveform == "uniform":
            continue
        starts = starts_within(given, question.motion or (8.0, 0.0), 60, rng, memory=False)
        theirs = runs(given, starts, 32_000)[:, 0]
        begun = np.repeat(record_of(given, loop_from_config(given)), len(starts))
        begun["xi"], begun["xi_dot"], begun["phase"] = starts[:, 0], starts[:, 1], starts[:, 3]
        begun["search"] = 512
        ours = answers_of(begun, sampled_loop.run_loops(begun, 32_000))
        decided = np.isin(theirs, (RESTS, BUZZES, MOVES_ON)) & (ours != UNDECIDED)
        same += int((ours[decided] == theirs[decided]).sum())
        different += int((ours[decided] != theirs[decided]).sum())
    assert same > 50
    assert different <= 0.01 * same


@pytest.mark.parametrize("kind", CLASSES)
def test_fresh_loops_are_what_they_are_called(kind: str) -> None:
    found = held_against(kind, 8, seed=101, starts=300)
    assert found.drawn == 8
    assert (found.false_proven, found.false_explored, found.provable_refused) == (0, 0, 0), found.listed


@pytest.mark.attack
@pytest.mark.parametrize("kind", CLASSES)
def test_many_fresh_loops_are_what_they_are_called(kind: str) -> None:
    found = held_against(kind, 300, seed=102, starts=2000)
    assert (found.false_proven, found.provable_refused) == (0, 0), found.listed
    assert found.false_explored <= 1, found.listed


def test_a_buzz_of_the_dampers_kicks_at_an_edge_is_found() -> None:
    """Friction holds the ticks of these loops, not what the damper makes of one: 16 and 9 of 10⁴ starts end so."""
    for number in (94, 168):
        question = list(draw("damping", number + 1, 201))[-1]
        found = assess(question.config, effort=CHECK, **question.asked).explored
        assert found is not None
        assert found.admissible
        assert found.buzzing > 0
        assert found.largest_cycle < 0.01
        alike = runs(question.config, starts_within(question.config, question.motion, 2000, np.random.default_rng(5)))
        assert alike[alike[:, 0] == BUZZES, 1].max(initial=0.0) <= 1.01 * found.largest_cycle


#: A very heavy device that grows by a hundredth in a minute from what it is released at.
SLOWLY = {"plant.inertia": 1.907364e-3, "plant.viscous": 3.9828e-6, "plant.coulomb": 0.0}
#: An averaged velocity whose first periods can put in more than the mass stores: nothing is proven.
OVERBRAKED = {
    "plant.inertia": 2.682e-7, "plant.viscous": 2.0256e-5, "plant.coulomb": 1.44685e-4,
    "spring.damping": 8.4744e-4, "spring.velocity_periods": 5,
}  # fmt: skip


def test_a_spring_that_grows_slowly_below_a_tick_is_no_buzz() -> None:
    given = config(SLOWLY)
    said = judge(given, 0.0, deflection=0.7315)
    assert said.verdict == "refused"
    assert "undecided" in said.reason or "moved on" in said.reason


def test_nothing_is_proven_where_the_first_periods_of_an_average_may_put_in_more_than_the_mass_stores() -> None:
    given = config(OVERBRAKED)
    proof = proof_of(given, loop_from_config(given))
    assert proof is not None
    assert proof.speed_limit == 0.0
    assert judge(given, 0.0).verdict == "refused"
    ended = runs(given, np.array([[0.0, -1e-4, 0.0, 0.0], [0.0, -0.0158, 0.0, 0.0]]))
    assert (ended[:, 0] == MOVES_ON).all()


def test_the_speed_limit_is_where_the_margin_is_zero() -> None:
    for question in draw("averaged velocity", 40, 77):
        proof = proof_of(question.config, loop_from_config(question.config))
        assert proof is not None
        if 0.0 < proof.speed_limit < math.inf:
            assert proof.margin(proof.speed_limit) == pytest.approx(0.0, abs=1e-6)
        assert proof.margin(1.01 * proof.speed_limit + 1e-9) < 0.0 or proof.speed_limit == math.inf


def _as_a_delay(given: Config) -> Config:
    return apply_settings(given, {"amplifier.bandwidth_hz": 0, "delay.computation_s": given.amplifier.delay})


def test_an_amplifier_that_rings_is_run_as_it_is() -> None:
    """As the delay of (5) all of these would be admitted; `simulate` and the other simulator show some of them grow."""
    drawn = list(draw("current loop", 34, 7))
    for number in (15, 16, 19, 33):
        given, asked = drawn[number].config, drawn[number].asked
        assert given.amplifier.damping_ratio < 0.6
        assert judge(_as_a_delay(given), 0.0, **asked).verdict == "admitted"
        assert judge(given, 0.0, **asked).verdict == "refused"
        found = explore(given, motion=drawn[number].motion, effort=GUARD)
        assert found.worst_start is not None
        assert "hapticd simulate" in found.command(given.period)
        xi, xi_dot = found.worst_start
        assert runs(given, np.array([[xi, xi_dot, 0.0, 0.0]]))[0, 0] == MOVES_ON
        seconds = max(1.0, 3.0 * found.worst_periods * given.period)
        assert simulate(given, seconds, deflection=xi, velocity=xi_dot)["outcome"] == "growing"
    for number in (0, 1, 2):
        given, asked = drawn[number].config, drawn[number].asked
        said = judge(given, 0.0, **asked)
        assert (said.verdict, "as the delay" in said.reason) == ("admitted", False)
        starts = starts_within(given, drawn[number].motion, 300, np.random.default_rng(number))
        assert (runs(given, starts, 4_000)[:, 0] != MOVES_ON).all()


def test_the_lag_of_an_amplifier_is_explored_as_effect_and_as_amplifier_alike() -> None:
    given = list(draw("current loop", 16, 7))[15].config
    amplifier = given.amplifier
    lag = {"name": "amplifier_lag", "f_a": amplifier.bandwidth_hz, "delta": amplifier.damping_ratio}
    listed = apply_settings(given, {"amplifier.bandwidth_hz": 0, "plant.effects": [lag]})
    assert explore(listed, effort=GUARD) == explore(given, effort=GUARD)
    behind = apply_settings(listed, {"amplifier.bandwidth_hz": 3000})
    assert "delay of (5) before amplifier_lag" in explore(behind, effort=GUARD).approximate[0]
    ends = [simulate(each, 0.05, deflection=3.3)["final"]["position"] for each in (given, listed)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)


def test_below_one_tick_theorem_2_forbids_growth_under_dither() -> None:
    dithered = {"plant.inertia": 1.2e-6, "plant.viscous": 9.6e-6, "plant.coulomb": 5.52233084e-6}
    found = assess(config(dithered | {"dither.target": "position", "dither.amplitude": 3, "dither.frequency_hz": 40}))
    assert found.explored is not None
    assert found.explored.growing == 0
