"""The choice: evidence between sets of laws, the one question asked of two of them, and the moves that come of it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student

from benchmarks.gap.disturbance import Coloured
from hapticd.effects.catalogue import CATALOGUE
from hapticd.effects.spec import Scale
from hapticd.gap import choose, constants, find_gap
from hapticd.gap.base_model import base_law, problem_of
from hapticd.gap.candidates import both_signs, candidates, scale_of
from hapticd.gap.choose import Search
from hapticd.gap.kernel.ticks import WHITE
from hapticd.gap.law_set import LawSet, evidence, is_at_noise_level, is_better, scored
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.propose import extensions, finished
from hapticd.gap.score import Score
from hapticd.gap.sets import needed_errors
from hapticd.gap.terms import term

SECONDS = 6.0
LEAST = 10.0
"""Nats that a law must gain in these tests."""
CANCELS = ("current_saturation", "load_dependent_friction", "torque_constant_error", "dac_quantization")
Hidden = Callable[..., Any]


@pytest.fixture(scope="module")
def biased(hidden: Hidden) -> LawSet:
    """The nominal model on a device with a bias."""
    recording, model = hidden([{"name": "constant_bias", "tau_0": 4e-4}], 11, SECONDS, Coloured(0.05, 0.05))
    return scored(nominal_fit(problem_of([recording], model)))


@pytest.fixture(scope="module")
def corrected(biased: LawSet) -> LawSet:
    """With the bias."""
    return scored(biased.fit.extended(term("constant_bias", {"tau_0": 3e-4}, (), 0.1)).approach(5, 4).maximise())


def chosen(hidden: Hidden, effects: list[dict[str, Any]], slugs: list[str], *given: Any) -> tuple[str, ...]:
    """The laws that a search among some of them chooses."""
    recording, model = hidden(effects, *given)
    *_, last = Search(problem_of([recording], model), slugs, is_asked=True).rounds()
    return last.chosen.laws


def test_a_set_has_no_evidence_against_itself(biased: LawSet) -> None:
    assert evidence(biased, biased) == (0.0, 0.0)


def test_evidence_is_gain_in_standard_errors(biased: LawSet, corrected: LawSet) -> None:
    gain, errors = evidence(corrected, biased)
    assert gain == pytest.approx(corrected.total - biased.total)
    assert gain > 50.0
    assert errors > needed_errors(corrected.held_out.size, len(CATALOGUE))
    lost, negative = evidence(biased, corrected)
    assert lost == -gain
    assert negative < 0.0


def test_what_is_gained_only_where_it_was_not_fitted_is_no_evidence(biased: LawSet, corrected: LawSet) -> None:
    """Beside 60 s of a play a friction wrong by a hundred-thousandth had gained 15 nats fitted, 60 held out, and a name."""
    lucky = replace(biased, held_out=biased.held_out + 5.0)
    assert evidence(lucky, biased) == (0.0, 0.0)
    unlucky = replace(biased, held_out=biased.held_out - 50.0)
    fitted = corrected.fit.log_likelihood - biased.fit.log_likelihood
    assert evidence(corrected, unlucky)[0] == pytest.approx(fitted)
    assert evidence(unlucky, corrected)[0] == pytest.approx(-fitted)


def test_a_gain_over_a_loud_model_varies_by_what_that_one_does_not_expect(biased: LawSet, corrected: LawSet) -> None:
    """Orders that closed 99 % of a motor's missing force and gained 740 nats had been one standard error: a shaft too heavy
    to feel its current takes little for unlikely."""
    louder = np.where(np.arange(biased.fit.noise.size) == WHITE, np.log(30.0), 0.0)
    loud = scored(biased.fit.with_noise(biased.fit.noise + louder))
    gain, errors = evidence(corrected, loud)
    assert gain > evidence(corrected, biased)[0]
    assert errors == pytest.approx(math.sqrt(2.0 * gain))  # it varies by no more than the better model expects


def test_discrete_choices_have_a_penalty(biased: LawSet, corrected: LawSet) -> None:
    dear = scored(corrected.fit, 7.0)
    assert dear.total == pytest.approx(corrected.total - 7.0, abs=1e-6)
    assert evidence(dear, biased)[0] == pytest.approx(evidence(corrected, biased)[0] - 7.0, abs=1e-6)


@pytest.mark.parametrize("blocks", [20, 60])
def test_more_competitors_need_more_evidence(blocks: int) -> None:
    assert needed_errors(blocks, 1) == pytest.approx(float(student.isf(constants.LEVEL, blocks - 1)))
    needed = [needed_errors(blocks, tried) for tried in (1, 2, 24)]
    assert needed == sorted(set(needed))
    assert student.sf(needed[-1], blocks - 1) * 24 == pytest.approx(constants.LEVEL)
    assert needed_errors(blocks, 0) == needed_errors(blocks, 1)
    assert needed_errors(20, 24) > needed_errors(60, 24) > 3.5


def test_a_law_more_must_be_sure_and_close_a_share(
    biased: LawSet, corrected: LawSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = is_better(corrected, biased, 4.0)
    assert (found.is_better, found.why) == (True, "the evidence is sufficient, and less force is missing")
    assert found.left < 0.3
    assert found.errors == evidence(corrected, biased)[1]
    assert is_better(corrected, biased, 1000.0).why == "the evidence is not sufficient"
    monkeypatch.setattr(constants, "SHARE", 0.99)
    found = is_better(corrected, biased, 4.0)
    assert (found.is_better, found.why) == (False, "as much force is missing as without it")


def test_what_a_slow_torque_explains_as_well_is_not_better(hidden: Hidden) -> None:
    recording, model = hidden([], 3, 2.0 * SECONDS, Coloured(0.25, 0.2))
    problem = problem_of([recording], model)
    reduced = scored(nominal_fit(problem))
    richer = scored(reduced.fit.extended(base_law(problem, "coulomb_friction")).approach(5, 3).maximise())
    assert not is_better(richer, reduced, 0.5).is_better
    assert reduced.with_slow_disturbance.fit.noise_values()[3] > constants.SHORT_CORRELATION_S


def test_of_two_that_predict_as_well_the_simpler_one_is_better(biased: LawSet, corrected: LawSet) -> None:
    """Gravity is a bias where its angle says nothing, with a number more."""
    values = {"m_g_l": 4e-1, "theta_0": -1e-3}
    gravity = scored(biased.fit.extended(term("gravity", values, (), 0.1)).approach(5, 4).maximise())
    assert is_better(corrected, gravity, 4.0).is_better
    assert not is_better(gravity, corrected, 4.0).is_better


def test_only_a_device_at_its_least_noise_is_quiet(hidden: Hidden, biased: LawSet) -> None:
    recording, model = hidden([], 11, SECONDS)
    assert is_at_noise_level(nominal_fit(problem_of([recording], model)))
    assert not is_at_noise_level(biased.fit)


def test_a_model_by_which_nothing_moves_explains_nothing(biased: LawSet) -> None:
    heavy = term("flexible_coupling", {"f_r": 30.0, "load_share": 0.99, "damping": 0.3}, (), 0.1)
    stuck = scored(biased.fit.extended(heavy))
    assert stuck.power == math.inf
    assert not is_at_noise_level(stuck.fit)
    assert is_better(stuck, biased, 2.0).is_better is False
    assert is_better(replace(biased, held_out=biased.held_out + 1.0), stuck, 2.0).left == 0.0


def test_extensions_are_ordered_by_their_held_out_score(biased: LawSet) -> None:
    found = extensions(biased, ["constant_bias", "coulomb_friction", "asymmetric_viscous", "gravity"], LEAST)
    totals = [one.total for one in found]
    assert totals == sorted(totals, reverse=True)
    assert "constant_bias" in {one.laws[-1] for one in found}
    assert extensions(biased, [], LEAST) == []


def test_rounds_end_when_nothing_is_left(biased: LawSet) -> None:
    search = Search(biased.fit.problem, ["constant_bias", "viscous_friction"], is_asked=True)
    rounds = list(search.rounds())
    assert [(one.move, one.law) for one in rounds if one.move == "add"] == [("add", "constant_bias")]
    assert rounds[-1].chosen.laws == ("constant_bias",)
    assert all(one.comparison is not None for one in rounds[1:])
    (named,) = search.named(rounds[-1].chosen)
    assert (named.law, named.ties) == ("constant_bias", ())
    assert named.comparison.is_better


def test_a_set_of_laws_is_fitted_once(biased: LawSet, corrected: LawSet) -> None:
    search = Search(biased.fit.problem, ["constant_bias"])
    first = search.sets.without(corrected, "constant_bias")
    runs = len(biased.fit.problem.runs)
    assert search.sets.without(corrected, "constant_bias") is first
    assert len(biased.fit.problem.runs) - runs <= 3  # where it begins, and no ascent


def test_nothing_to_consider_is_the_model_as_given(biased: LawSet) -> None:
    (only,) = Search(biased.fit.problem, []).rounds()
    assert (only.move, only.chosen.laws) == ("begin", ())


def test_a_law_that_stands_for_another_gives_way_to_its_limit(hidden: Hidden) -> None:
    effects = [{"name": "inertia_error", "r": -0.155}, {"name": "constant_bias", "tau_0": -3e-4}]
    slugs = ["inertia_error", "constant_bias", "return_spring", "gravity"]
    assert set(chosen(hidden, effects, slugs, 11, SECONDS, Coloured(0.05, 0.05))) == {"inertia_error", "constant_bias"}


def test_base_parameters_that_are_all_wrong_by_one_factor_are_a_torque_constant(hidden: Hidden) -> None:
    effects = [{"name": "torque_constant_error", "r": 0.2}]
    found = chosen(hidden, effects, list(CATALOGUE), 11, SECONDS, Coloured(0.05, 0.01))
    assert found == ("torque_constant_error",)


def test_two_wrong_parameters_are_not_said_as_three(hidden: Hidden) -> None:
    """An inertia and a torque constant: by the torque constant's factor taken out, all but that are wrong."""
    effects = [{"name": "inertia_error", "r": -0.15}, {"name": "torque_constant_error", "r": 0.3}]
    slugs = ["inertia_error", "viscous_friction", "coulomb_friction", "torque_constant_error"]
    assert set(chosen(hidden, effects, slugs, 11, SECONDS)) == {"torque_constant_error", "inertia_error"}


def test_two_errors_that_make_up_for_each_other_are_found_together(hidden: Hidden) -> None:
    """With the friction right but not the base, as much force is missing as with both wrong."""
    effects = [{"name": "load_dependent_friction", "kappa": 0.24}, {"name": "torque_constant_error", "r": 0.3}]
    slugs = [
        "load_dependent_friction",
        "inertia_error",
        "viscous_friction",
        "coulomb_friction",
        "torque_constant_error",
    ]
    assert set(chosen(hidden, effects, slugs, 11, SECONDS)) == {"load_dependent_friction", "torque_constant_error"}


def test_a_device_wrong_by_one_factor_in_all_is_the_model(hidden: Hidden) -> None:
    recording, model = hidden([], 11, SECONDS)
    problem = problem_of([recording], model)
    given = fit = nominal_fit(problem)
    for slug in ("inertia_error", "viscous_friction", "coulomb_friction"):
        (own,) = base_law(problem, slug).coordinates
        fit = fit.extended(base_law(problem, slug, 1.25 * math.exp(own.centre)))
    fit = fit.extended(term("torque_constant_error", {"r": 0.25}, (), 1.0))
    prior = 1.5 * (math.log(1.25) / constants.BASE_PRIOR) ** 2
    assert fit.log_likelihood + prior == pytest.approx(given.log_likelihood, abs=1e-3)
    assert is_at_noise_level(fit)


def test_the_step_of_a_converter_is_found_to_its_spike(hidden: Hidden) -> None:
    """A thousandth beside it hundreds of nats are missing, for which any law may then take the credit."""
    recording, model = hidden([{"name": "dac_quantization", "q": 0.012156}], 1, 10.0)
    present = scored(nominal_fit(problem_of([recording], model)))
    (found,) = extensions(present, ["dac_quantization"], LEAST)
    assert float(np.exp(finished(found).law("dac_quantization").start[0])) == pytest.approx(0.012156, rel=5e-5)


def test_a_law_at_its_limit_is_not_proposed(biased: LawSet, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [one.laws for one in extensions(biased, ["constant_bias"], LEAST)] == [("constant_bias",)]
    monkeypatch.setattr("hapticd.gap.terms.Term.at_bounds", lambda law, u: [law.coordinates[0].name])
    assert extensions(biased, ["constant_bias"], LEAST) == []


def test_a_law_that_cancels_the_drive_is_not_proposed(biased: LawSet, monkeypatch: pytest.MonkeyPatch) -> None:
    """What cancels the drive fits anything: it had pushed the true law out before it was refused itself."""
    slugs = ["constant_bias", "gravity", "return_spring"]
    best = extensions(biased, slugs, LEAST)[0].laws[-1]
    monkeypatch.setattr("hapticd.gap.propose.keeps_the_drive", lambda fit, present: fit.terms[-1].slug != best)
    found = [one.laws[-1] for one in extensions(biased, slugs, LEAST)]
    assert found
    assert best not in found


@pytest.mark.parametrize("seed", [12, 13])
def test_a_current_that_has_nothing_to_do_with_the_motion_is_no_effect(hidden: Hidden, seed: int) -> None:
    """What cancels the drive fits best, and says nothing of the device."""
    recording, model = hidden([], seed, SECONDS)
    other, _ = hidden([], seed + 20, SECONDS)
    result = find_gap([replace(recording, current=other.current)], model, candidates=CANCELS, design=False)
    assert result.verdict not in ("effect_found", "ambiguous"), result.statement
    entries = {step.effect: step.entry for step in result.steps}
    assert float(str(entries.get("load_dependent_friction", {}).get("kappa", 0.0))) < 0.9
    assert float(str(entries.get("current_saturation", {}).get("i_max", 1.0))) > 0.02


def test_effects_of_the_same_law_are_not_named_twice(hidden: Hidden) -> None:
    recording, model = hidden([{"name": "constant_bias", "tau_0": 6e-4}], 14, SECONDS)
    result = find_gap([recording], model, candidates=["constant_bias", "asymmetric_coulomb"], design=False)
    assert result.effects == ("constant_bias",)
    assert result.steps[0].indistinguishable_from == ("asymmetric_coulomb",)
    (interval,) = [result.steps[0].parameters["tau_0"].ci95]
    assert interval[0] <= result.steps[0].parameters["tau_0"].value <= interval[1]
    assert np.mean(interval) == pytest.approx(6e-4, rel=0.01)


def test_an_interruption_keeps_what_was_found(hidden: Hidden) -> None:
    effects = [{"name": "constant_bias", "tau_0": 6e-4}, {"name": "viscous_friction", "r": 3.0}]
    recording, model = hidden(effects, 15, SECONDS)
    calls = []

    def progress(share: float, text: str) -> None:
        calls.append(text)
        if text == "trying effects" and calls.count(text) == 2:
            raise KeyboardInterrupt

    result = find_gap(
        [recording], model, candidates=["constant_bias", "viscous_friction"], progress=progress, design=False
    )
    assert result.interrupted
    assert len(result.effects) == 1
    assert result.statement.startswith("Interrupted: ")

    def at_once(share: float, text: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        find_gap([recording], model, progress=at_once)


def test_an_unknown_candidate_is_refused(hidden: Hidden) -> None:
    recording, model = hidden([], 1, SECONDS)
    with pytest.raises(ValueError, match="unknown effect 'gravitas'"):
        find_gap([recording], model, candidates=["gravity", "gravitas"])


def test_what_may_be_negative_starts_on_either_side() -> None:
    starts = [
        term(slug, values, (), 0.1)
        for slug, values in (
            ("constant_bias", {"tau_0": 1e-3}),
            ("stribeck", {"s": 0.1}),
            ("load_dependent_friction", {"kappa": 0.1}),
        )
    ]
    assert [(item.slug, item.start) for item in both_signs(starts)] == [
        ("constant_bias", (1e-3,)),
        ("stribeck", (0.1,)),
        ("load_dependent_friction", (0.1,)),
        ("constant_bias", (-1e-3,)),
        ("stribeck", (-0.1,)),
    ]


def test_a_start_promises_what_it_gains_with_the_noise_that_suits_it(hidden: Hidden) -> None:
    """With the noise of a model without it, the stick and slip of a bristle gain little or nothing."""
    recording, model = hidden([{"name": "presliding", "breakaway": 0.007, "sigma_1": 9e-4}], 11, SECONDS)
    fit = nominal_fit(problem_of([recording], model))
    (found,) = candidates(fit, ["presliding"], LEAST)
    assert found.expected_gain > 5.0 * (fit.extended(found.term).log_likelihood - fit.log_likelihood)


def test_a_start_from_which_the_shaft_runs_away_promises_nothing(biased: LawSet) -> None:
    fit = biased.fit.on(biased.fit.problem)
    fit.out["mean"][5] = -1e200
    assert Score(fit).along(term("constant_bias", {"tau_0": 1e-4}, (), 0.1)).expected_gain == 0.0


def test_a_resonance_is_found_beside_a_slow_torque(hidden: Hidden) -> None:
    """With the noise of a model without it, the right frequency looks worse than none."""
    coupling = {"name": "flexible_coupling", "f_r": 29.0, "load_share": 0.36, "damping": 0.035}
    recording, model = hidden([coupling], 8, SECONDS, Coloured(0.05, 0.2))
    fit = nominal_fit(problem_of([recording], model))
    (found,) = candidates(fit, ["flexible_coupling"], LEAST)
    assert float(np.exp(found.term.start[0])) == pytest.approx(29.0, rel=0.05)
    assert found.expected_gain > 1000.0


def test_what_is_hidden_in_the_motion_is_looked_for_at_its_size_whatever_the_resolution() -> None:
    """Positions in rad have cells far below any play: starts in counts had ended a thousand times below the truth."""
    sizes = (1e-4, 1e-5, 1e-3, 1e-2)
    for resolution in (1e-9, 1e-3):
        scale = Scale(*sizes[:4], resolution, 1e-3, 20.0, 0.2, (1.0,) * 5, (1.0,) * 7, (0.0,) * 5, 2.0)
        for slug, name in (("backlash", "gap"), ("presliding", "breakaway")):
            found = [start[name] for start in CATALOGUE[slug].starts(scale)]
            assert min(found) < 6e-3
            assert max(found) == pytest.approx(0.2)
            assert all(b < 3.5 * a for a, b in itertools.pairwise(sorted(found)))


def test_what_a_quarter_of_the_record_does_not_show_is_found_and_doubled(hidden: Hidden) -> None:
    """The blocks of a first look have no fast motion; and within a few counts the likelihood has a maximum of its own."""
    effect = {"name": "encoder_eccentricity", "e": 0.02, "phi": 5.0}
    recording, model = hidden([effect], 4, 20.0, Coloured(0.25, 0.05))
    fit = nominal_fit(problem_of([recording], model))
    (found,) = candidates(fit, ["encoder_eccentricity"], LEAST)
    assert float(np.exp(found.term.start[0])) == pytest.approx(0.02, rel=0.5)
    assert found.expected_gain == fit.extended(found.term).log_likelihood - fit.log_likelihood
    starts = list(CATALOGUE["encoder_eccentricity"].starts(scale_of(fit)))
    gains = []
    for part in (fit, fit.on(fit.problem.subsample())):
        part.differentiate()
        gains.append(max(Score(part).along(term(found.slug, values, (), 0.1)).expected_gain for values in starts))
    assert found.expected_gain > 2.0 * gains[0] > 100.0 * gains[1]


@pytest.mark.parametrize(("s", "omega_s"), [(-0.5, 3.0), (-0.3, 20.0)])
def test_friction_that_rises_from_rest_is_found(hidden: Hidden, s: float, omega_s: float) -> None:
    """A friction that falls over the whole range of speeds looks like it from afar: both signs of a law are begun with."""
    recording, model = hidden([{"name": "stribeck", "s": s, "omega_s": omega_s}], 31, 8.0)
    result = find_gap([recording], model, design=False)
    assert result.effects == ("stribeck",), result.statement
    (step,) = result.steps
    assert step.parameters["s"].value == pytest.approx(s, abs=0.01)
    assert step.parameters["omega_s"].value == pytest.approx(omega_s, rel=0.01)


@pytest.mark.parametrize(("slow", "ties"), [(8.0, ()), (0.0, ("asymmetric_coulomb",))], ids=["beaten", "equal"])
def test_what_a_slow_disturbance_makes_equal_is_a_tie(
    biased: LawSet, corrected: LawSet, monkeypatch: pytest.MonkeyPatch, slow: float, ties: tuple[str, ...]
) -> None:
    """A late device of a slow drive predicts as a lag does with one disturbance, and as lost commands with the other."""
    rival = scored(biased.fit.extended(term("asymmetric_coulomb", {"a": 0.0}, (), 0.1)).approach(5, 4).maximise())

    def errors(one: LawSet, other: LawSet) -> tuple[float, float]:
        if one is corrected and other is rival:
            return 30.0, 8.0
        if one is rival and other is corrected:
            return -30.0, -8.0
        if one is rival.with_slow_disturbance:
            return -0.5 * slow**2, -slow
        return evidence(one, other)

    monkeypatch.setattr(choose, "evidence", errors)
    monkeypatch.setattr(choose, "extensions", lambda *_: [corrected, rival])
    monkeypatch.setattr(choose, "finished", lambda one: one)
    search = Search(biased.fit.problem, ["constant_bias", "asymmetric_coulomb"], is_asked=True)
    *_, last = search.rounds()
    (named,) = search.named(last.chosen)
    assert (named.law, tuple(one.laws[-1] for one in named.ties)) == ("constant_bias", ties)
