"""The selection: evidence between hypotheses, what it must exceed, and laws that fit anything because they cancel all."""

from __future__ import annotations

import copy
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
from hapticd.gap import constants, find_gap, late_record
from hapticd.gap.base_model import problem_of
from hapticd.gap.candidates import both_signs, candidates, scale_of
from hapticd.gap.competition import (
    Contender,
    CrossValidated,
    Round,
    admitted,
    closes,
    compete,
    cross_validate,
    evidence,
    is_exact,
    is_material,
    round_of,
    simplest_first,
)
from hapticd.gap.corrections import CORRECTIONS, tell_with_one_less
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.ticks import DISTURBANCE, WHITE
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.score import Score
from hapticd.gap.search import (
    _beside,
    _is_more,
    _is_right,
    _next,
    critical,
    is_quiet,
    least_gain,
    look_back,
    search,
    withstanding,
)
from hapticd.gap.terms import Term, term

SECONDS = 6.0
Hidden = Callable[..., Any]


@pytest.fixture(scope="module")
def biased(hidden: Hidden) -> CrossValidated:
    """The nominal model on a device with a bias."""
    recording, model = hidden([{"name": "constant_bias", "tau_0": 4e-4}], 11, SECONDS, Coloured(0.05, 0.05))
    return cross_validate(nominal_fit(problem_of([recording], model)))


@pytest.fixture(scope="module")
def corrected(biased: CrossValidated) -> CrossValidated:
    """With the bias."""
    return cross_validate(
        biased.fit.extended(term("constant_bias", {"tau_0": 3e-4}, (), 0.1)).approach(5, 4).maximise()
    )


def test_a_hypothesis_has_no_evidence_against_itself(biased: CrossValidated) -> None:
    assert evidence(biased, biased) == (0.0, 0.0)


def test_evidence_is_gain_in_standard_errors(biased: CrossValidated, corrected: CrossValidated) -> None:
    gain, errors = evidence(corrected, biased)
    assert gain == pytest.approx(corrected.total - biased.total)
    assert gain > 50.0
    assert errors > critical(corrected.held_out.size, len(CATALOGUE))
    lost, negative = evidence(biased, corrected)
    assert lost == -gain
    assert negative < 0.0


def test_what_is_gained_only_where_it_was_not_fitted_is_no_evidence(
    biased: CrossValidated, corrected: CrossValidated
) -> None:
    """Beside 60 s of a play a friction wrong by a hundred-thousandth had gained 15 nats fitted, 60 held out, and a name."""
    lucky = replace(biased, held_out=biased.held_out + 5.0)
    assert evidence(lucky, biased) == (0.0, 0.0)
    unlucky = replace(biased, held_out=biased.held_out - 50.0)
    fitted = corrected.fit.log_likelihood - biased.fit.log_likelihood
    assert evidence(corrected, unlucky)[0] == pytest.approx(fitted)
    assert evidence(unlucky, corrected)[0] == pytest.approx(-fitted)


def test_a_gain_over_a_loud_model_varies_by_what_that_one_does_not_expect(
    biased: CrossValidated, corrected: CrossValidated
) -> None:
    """Orders that closed 99 % of a motor's missing force and gained 740 nats had been one standard error: a shaft too heavy
    to feel its current takes little for unlikely."""
    louder = np.where(np.arange(biased.fit.noise.size) == WHITE, np.log(30.0), 0.0)
    loud = cross_validate(biased.fit.with_noise(biased.fit.noise + louder))
    gain, errors = evidence(corrected, loud)
    assert gain > evidence(corrected, biased)[0]
    assert errors == pytest.approx(math.sqrt(2.0 * gain))  # it varies by no more than the better model expects


def test_discrete_choices_have_a_penalty(biased: CrossValidated, corrected: CrossValidated) -> None:
    dear = cross_validate(corrected.fit, 7.0)
    assert dear.total == pytest.approx(corrected.total - 7.0, abs=1e-6)
    assert evidence(dear, biased)[0] == pytest.approx(evidence(corrected, biased)[0] - 7.0, abs=1e-6)


@pytest.mark.parametrize("blocks", [20, 60])
def test_more_competitors_need_more_evidence(blocks: int) -> None:
    assert critical(blocks, 1) == pytest.approx(float(student.isf(constants.LEVEL, blocks - 1)))
    needed = [critical(blocks, tried) for tried in (1, 2, 24)]
    assert needed == sorted(set(needed))
    assert student.sf(needed[-1], blocks - 1) * 24 == pytest.approx(constants.LEVEL)
    assert critical(blocks, 0) == critical(blocks, 1)
    assert critical(20, 24) > critical(60, 24) > 3.5


def test_only_a_device_at_its_least_noise_is_quiet(hidden: Hidden, biased: CrossValidated) -> None:
    recording, model = hidden([], 11, SECONDS)
    assert is_quiet(nominal_fit(problem_of([recording], model)))
    assert not is_quiet(biased.fit)


def test_contenders_are_ranked_by_their_gain(biased: CrossValidated) -> None:
    contenders = compete(biased, ["constant_bias", "coulomb_friction", "asymmetric_viscous", "gravity"], 10.0)
    assert contenders
    gains = [contender.gain for contender in contenders]
    assert gains == sorted(gains, reverse=True)
    assert "constant_bias" in {contender.slug for contender in contenders}


def test_rounds_end_when_nothing_is_left(biased: CrossValidated) -> None:
    rounds: list[Round] = []
    told: list[float] = []
    unnamed = search(biased, ["constant_bias", "viscous_friction"], lambda share, text: told.append(share), rounds)
    assert [found.taken.slug for found in rounds] == ["constant_bias"]
    assert rounds[0].before is biased
    assert unnamed is None
    assert told == sorted(told)
    assert 0.0 <= told[0] <= told[-1] < 1.0


def test_nothing_to_consider_is_no_round(biased: CrossValidated) -> None:
    rounds: list[Round] = []
    assert search(biased, [], lambda share, text: None, rounds) is None
    assert rounds == []


def test_indistinguishable_laws_are_asked_again_when_more_is_known(hidden: Hidden) -> None:
    ripple = {"name": "torque_ripple", "orders": [14], "amplitudes": [2e-3], "phases": [1.0]}
    recording, model = hidden([{"name": "transport_delay", "t_d": 6e-4}, ripple], 3, SECONDS)
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    needed = least_gain(critical(20, 24))
    both = compete(first, ["dropped_samples", "transport_delay"], needed)
    assert {contender.slug for contender in both} == {"dropped_samples", "transport_delay"}
    wrong_first = sorted(both, key=lambda contender: contender.slug)
    rounds = [Round(first, tuple(wrong_first), ("transport_delay",))]
    rounds.append(Round(wrong_first[0].judged, tuple(compete(wrong_first[0].judged, ["torque_ripple"], needed)), ()))
    look_back(rounds, list(CATALOGUE), 0, critical(first.held_out.size, 24), needed)
    assert [found.taken.slug for found in rounds] == ["torque_ripple", "transport_delay"]
    assert [found.indistinguishable for found in rounds] == [(), ()]
    # What was named before is still there to be compared with, and its penalty no longer counts.
    assert [contender.slug for contender in rounds[-1].contenders] == ["transport_delay", "dropped_samples"]
    assert evidence(rounds[-1].taken.judged, rounds[-1].contenders[1].judged)[1] > constants.INDISTINGUISHABLE
    assert rounds[-1].taken.judged.penalty == pytest.approx(sum(found.taken.penalty for found in rounds))


CANCELS = ("current_saturation", "load_dependent_friction", "torque_constant_error", "dac_quantization")


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
        term(slug, values, (), 0.1) for slug, values in (("constant_bias", {"tau_0": 1e-3}), ("stribeck", {"s": 0.1}))
    ]
    assert [(item.slug, item.start) for item in both_signs(starts)] == [
        ("constant_bias", (1e-3,)),
        ("stribeck", (0.1,)),
        ("constant_bias", (-1e-3,)),
    ]


def _named(first: CrossValidated, *slugs: str) -> list[Round]:
    """Rounds in which these effects were taken, one after the other."""
    rounds: list[Round] = []
    for slug in slugs:
        before = rounds[-1].taken.judged if rounds else first
        rounds.append(Round(before, tuple(compete(before, [slug], 0.0)), ()))
    return rounds


def test_a_law_that_stood_in_gives_way_to_its_limit(hidden: Hidden) -> None:
    effects = [{"name": "inertia_error", "r": -0.155}, {"name": "constant_bias", "tau_0": -3e-4}]
    recording, model = hidden(effects, 11, SECONDS, Coloured(0.05, 0.05))
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    rounds = _named(first, "return_spring", "inertia_error")
    look_back(rounds, list(CATALOGUE), 0, critical(20, 24), least_gain(critical(20, 24)))
    assert [each.taken.slug for each in rounds] == ["inertia_error", "constant_bias"]
    path = withstanding(first, rounds, len(CATALOGUE))
    assert [[item.slug for item in judged.fit.terms] for judged in path] == [
        [],
        ["inertia_error"],
        ["inertia_error", "constant_bias"],
    ]


def test_a_limit_is_climbed_to_the_end_before_it_is_told_apart(hidden: Hidden) -> None:
    """A grip whose edges were found beside gravity held a constant torque back, and a ripple made up for the gravity."""
    hand = {
        "name": "hand_impedance", "m_h": 9.3e-4, "b_h": 6.5e-3, "k_h": 0.13, "on_s": 10.15, "off_s": 16.87, "rest": -0.276,
    }  # fmt: skip
    effects = [{"name": "constant_bias", "tau_0": -0.01375}, hand]
    recording, model = hidden(effects, 752938998, 20.0, device="heavy")
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    needed_errors = critical(20, 24)
    (gravity,) = _named(first, "gravity")
    (grip,) = compete(gravity.taken.judged, ["hand_impedance"], least_gain(needed_errors))
    rounds = [gravity, round_of(gravity.taken.judged, [grip])]
    look_back(rounds, list(CATALOGUE), 0, needed_errors, least_gain(needed_errors))
    assert [each.taken.slug for each in rounds] == ["hand_impedance", "constant_bias"]


def test_what_a_slow_torque_explains_as_well_is_not_named(hidden: Hidden) -> None:
    recording, model = hidden([], 3, 2.0 * SECONDS, Coloured(0.25, 0.2))
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    rounds = _named(first, "coulomb_friction")
    path = withstanding(first, rounds, len(CATALOGUE))
    assert rounds == []
    assert [judged.fit.terms for judged in path] == [()]
    assert path[0].fit.noise_values()[3] > constants.SHORT_MEMORY_S


def test_no_further_law_stands_at_the_end_of_its_range(hidden: Hidden, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slow disturbance may lead it there after it was taken."""
    effects = [{"name": "coulomb_friction", "r": 0.5}, {"name": "constant_bias", "tau_0": -3e-4}]
    recording, model = hidden(effects, 12, SECONDS)
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    rounds = _named(first, "coulomb_friction", "constant_bias")
    assert len(withstanding(first, rounds, len(CATALOGUE))) == 3
    monkeypatch.setattr(Term, "at_bounds", lambda law, u: [law.coordinates[0].name])
    path = withstanding(first, rounds, len(CATALOGUE))
    assert [[item.slug for item in judged.fit.terms] for judged in path] == [[], ["coulomb_friction"]]


def test_a_late_record_wins_only_where_no_law_of_the_device_does_as_well(biased: CrossValidated) -> None:
    fit = biased.fit

    def contender(item: Term) -> Contender:
        return Contender(item.slug, cross_validate(fit.extended(item)), 0.0, 0.0)

    late = contender(late_record.starts("transport_delay", fit.problem.series.period_s)[0])
    as_good, poor = (contender(term("viscous_friction", {"r": r}, (), 1.0)) for r in (1e-6, 5.0))
    assert late_record.is_late(late.law)
    assert [one.slug for one in simplest_first([late, as_good], 4.0)] == ["viscous_friction", "transport_delay"]
    assert [one.slug for one in simplest_first([late, poor], 4.0)] == ["transport_delay", "viscous_friction"]
    sure = replace(late, evidence=5.0)
    assert [one.slug for one in simplest_first([sure, as_good], 4.0)] == ["transport_delay", "viscous_friction"]


def test_a_late_record_that_closes_and_gains_most_need_not_be_sure(
    biased: CrossValidated, corrected: CrossValidated, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is no name. For want of a fifth of a standard error two effects had been named where a filter closed 85 %."""
    monkeypatch.setattr("hapticd.gap.search.is_artefact", lambda fit, other: False)
    late = cross_validate(
        biased.fit.extended(late_record.starts("transport_delay", biased.fit.problem.series.period_s)[0])
    )
    best, other = (
        Contender("transport_delay", replace(corrected, fit=late.fit), 200.0, 4.0),
        Contender("constant_bias", corrected, 30.0, 4.5),
    )
    monkeypatch.setattr("hapticd.gap.search.closes", lambda fit, other: fit is late.fit)
    found = _next([best, other], biased, 8.0, 4.3)
    assert found is not None
    assert found.taken.slug == "transport_delay"


def test_two_errors_that_make_up_for_each_other_are_told_together(hidden: Hidden) -> None:
    """With the friction right but not the torque constant, as much force is missing as with both wrong."""
    effects = [{"name": "load_dependent_friction", "kappa": 0.24}, {"name": "torque_constant_error", "r": 0.3}]
    recording, model = hidden(effects, 11, SECONDS)
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    alone = term("load_dependent_friction", {"kappa": 0.24}, (), 0.1)
    assert not closes(first.fit.extended(alone).maximise(), first.fit)
    slugs = ["load_dependent_friction", "torque_constant_error"]
    rounds: list[Round] = []
    assert search(first, slugs, lambda share, text: None, rounds) is None
    assert sorted(each.taken.slug for each in rounds) == slugs
    last = rounds[-1].taken.judged
    estimates = {term.slug: float(last.fit.u[last.fit.columns(k)][0]) for k, term in enumerate(last.fit.terms)}
    assert estimates == pytest.approx({slugs[0]: 0.24, slugs[1]: 0.3}, rel=0.02)


@pytest.mark.parametrize(("slug", "anything"), [("inertia_error", True), ("stribeck", False)])
def test_of_two_that_make_up_for_each_other_one_is_a_wrong_base_parameter(
    biased: CrossValidated, corrected: CrossValidated, slug: str, anything: bool
) -> None:
    """A gravity had kept a wrong inertia from closing anything, and was not asked."""
    slugs = ["gravity", "coulomb_friction", "inertia_error", "stribeck"]
    doubtful = Round(biased, (Contender(slug, biased, 500.0, 8.0),), ())
    assert _beside([doubtful], slugs) == (slugs if anything else ["coulomb_friction", "inertia_error"])
    closing_one = Round(biased, (Contender(slug, corrected, 500.0, 2.0),), ())
    assert _beside([closing_one], slugs) == _beside([], slugs) == slugs


@pytest.mark.parametrize(("slug", "enough"), [("backlash", False), ("constant_bias", True)])
def test_a_small_law_beside_what_remembers_is_not_material_for_leaving_chance(
    biased: CrossValidated, monkeypatch: pytest.MonkeyPatch, slug: str, enough: bool
) -> None:
    """Lost commands and Stribeck friction make up for what the filter takes for known of a contact."""
    monkeypatch.setattr("hapticd.gap.competition.is_all_chance", lambda fit: True)
    values = next(iter(CATALOGUE[slug].starts(scale_of(biased.fit))))
    beside = replace(biased, fit=biased.fit.extended(term(slug, values, (), 0.1)))
    assert is_material(beside, beside) == enough
    assert is_material(beside, biased)
    own = beside.fit.problem.with_free_memory()
    remembers = replace(own, base=beside.fit.device())  # of the model, and not only of what was added
    assert is_exact(Fit(remembers, (), biased.fit.u)) == enough


@pytest.mark.parametrize(("slug", "enough"), [("backlash", False), ("constant_bias", True)])
def test_beside_a_slow_disturbance_too_what_remembers_asks_for_a_share(
    biased: CrossValidated, monkeypatch: pytest.MonkeyPatch, slug: str, enough: bool
) -> None:
    monkeypatch.setattr("hapticd.gap.search.keeps_the_drive", lambda fit, present: True)
    monkeypatch.setattr("hapticd.gap.search.evidence", lambda whole, without: (100.0, 10.0))
    monkeypatch.setattr("hapticd.gap.search.is_all_chance", lambda fit: True)
    values = next(iter(CATALOGUE[slug].starts(scale_of(biased.fit))))
    beside = replace(biased, fit=biased.fit.extended(term(slug, values, (), 0.1)))
    assert _is_more(beside, beside, 20) == enough


def test_what_is_sure_but_closes_nothing_is_told_and_not_named(hidden: Hidden) -> None:
    effects = [{"name": "load_dependent_friction", "kappa": 0.24}, {"name": "torque_constant_error", "r": 0.3}]
    recording, model = hidden(effects, 11, SECONDS)
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    rounds: list[Round] = []
    assert search(first, ["load_dependent_friction"], lambda share, text: None, rounds) == "load_dependent_friction"
    assert rounds == []


def test_a_start_promises_what_it_gains_with_the_noise_that_suits_it(hidden: Hidden) -> None:
    """With the noise of a model without it, the stick and slip of a bristle gain little or nothing."""
    recording, model = hidden([{"name": "presliding", "breakaway": 0.007, "sigma_1": 9e-4}], 11, SECONDS)
    fit = nominal_fit(problem_of([recording], model))
    (found,) = candidates(fit, ["presliding"], least_gain(critical(20, 24)))
    assert found.promise > 5.0 * (fit.extended(found.term).log_likelihood - fit.log_likelihood)


def test_a_start_from_which_the_shaft_runs_away_promises_nothing(biased: CrossValidated) -> None:
    fit = biased.fit.on(biased.fit.problem)
    fit.out["mean"][5] = -1e200
    assert Score(fit).along(term("constant_bias", {"tau_0": 1e-4}, (), 0.1)).promise == 0.0


def test_a_resonance_is_found_beside_a_slow_torque(hidden: Hidden) -> None:
    """With the noise of a model without it, the right frequency looks worse than none."""
    coupling = {"name": "flexible_coupling", "f_r": 29.0, "load_share": 0.36, "damping": 0.035}
    recording, model = hidden([coupling], 8, SECONDS, Coloured(0.05, 0.2))
    fit = nominal_fit(problem_of([recording], model))
    (found,) = candidates(fit, ["flexible_coupling"], least_gain(critical(20, 24)))
    assert float(np.exp(found.term.start[0])) == pytest.approx(29.0, rel=0.05)
    assert found.promise > 1000.0


def test_an_inertia_gives_way_to_the_torque_constant_that_it_stood_in_for(hidden: Hidden) -> None:
    recording, model = hidden([{"name": "torque_constant_error", "r": 0.2}], 11, SECONDS, Coloured(0.05, 0.01))
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    rounds = _named(first, "inertia_error", "coulomb_friction")
    look_back(rounds, list(CATALOGUE), 0, critical(20, 24), least_gain(critical(20, 24)))
    assert [each.taken.slug for each in rounds] == ["torque_constant_error"]


def test_an_artefact_makes_way_for_the_next_of_its_round(
    biased: CrossValidated, corrected: CrossValidated, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither for sure nor in doubt: a sure law had been taken out with it."""
    artefact = Contender("constant_bias", corrected, 100.0, 6.0)
    genuine = Contender("constant_bias", replace(corrected, fit=copy.copy(corrected.fit)), 90.0, 6.0)
    monkeypatch.setattr("hapticd.gap.search.is_artefact", lambda better, other: better is artefact.judged.fit)
    new = _next([artefact, genuine], biased, 5.0, 4.0)
    assert new is not None
    assert len(new.contenders) == 1
    monkeypatch.setattr("hapticd.gap.search.is_artefact", lambda better, other: True)
    assert _next([artefact, genuine], biased, 5.0, 4.0) is None


def test_two_wrong_parameters_are_not_told_as_three(hidden: Hidden) -> None:
    """An inertia and a torque constant: by the torque constant's factor taken out, all but that are wrong."""
    effects = [{"name": "inertia_error", "r": -0.15}, {"name": "torque_constant_error", "r": 0.3}]
    recording, model = hidden(effects, 11, SECONDS)
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    rounds = _named(first, "torque_constant_error", "coulomb_friction", "viscous_friction")
    rounds[0] = replace(rounds[0], indistinguishable=("inertia_error", "hand_impedance"))
    three = rounds[-1].taken.judged
    needed = least_gain(critical(20, 24))
    tell_with_one_less(rounds, ["viscous_friction", "coulomb_friction", "torque_constant_error"], 0, needed)
    assert len(rounds) == 3, "the fourth may not be named"
    tell_with_one_less(rounds, list(CATALOGUE), 0, needed)
    assert [each.taken.slug for each in rounds] == ["torque_constant_error", "inertia_error"]
    assert rounds[0].indistinguishable == ("hand_impedance",), "what is named is not told as another name"
    two = rounds[-1].taken.judged
    assert two.fit.log_likelihood == pytest.approx(three.fit.log_likelihood, abs=1.0)
    assert two.fit.u[-2:] == pytest.approx([0.3, -0.15], rel=0.01)


def test_a_device_wrong_by_one_factor_in_all_is_the_model(hidden: Hidden) -> None:
    recording, model = hidden([], 11, SECONDS)
    fit = nominal_fit(problem_of([recording], model))
    for slug in CORRECTIONS:
        fit = fit.extended(term(slug, {"r": 0.25}, (), 1.0))
    assert fit.log_likelihood == pytest.approx(nominal_fit(problem_of([recording], model)).log_likelihood, abs=1e-3)
    assert is_quiet(fit)


def test_what_a_slow_torque_does_as_well_makes_way_for_the_next_of_its_round(
    hidden: Hidden, monkeypatch: pytest.MonkeyPatch
) -> None:
    effects = [{"name": "constant_bias", "tau_0": 6e-4}, {"name": "viscous_friction", "r": 1.0}]
    recording, model = hidden(effects, 11, SECONDS)
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    slugs = ["constant_bias", "viscous_friction"]

    def found() -> list[str]:
        rounds: list[Round] = []
        search(first, slugs, lambda share, text: None, rounds)
        return [each.taken.slug for each in rounds]

    assert sorted(found()) == slugs
    best = found()[0]
    monkeypatch.setattr("hapticd.gap.search._withstands", lambda last, tried: last.taken.slug != best)
    assert found() == [slug for slug in slugs if slug != best]


def test_a_name_in_doubt_stands_if_it_is_sure_beside_the_next(hidden: Hidden, monkeypatch: pytest.MonkeyPatch) -> None:
    effects = [{"name": "constant_bias", "tau_0": 4e-4}, {"name": "viscous_friction", "r": 1.0}]
    recording, model = hidden(effects, 11, SECONDS)
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    needed = least_gain(critical(20, 24))
    slugs = ["constant_bias", "viscous_friction"]
    alone = compete(first, slugs, needed)
    (beside,) = compete(alone[0].judged, [slug for slug in slugs if slug != alone[0].slug], needed)
    without = cross_validate(beside.judged.fit.without(0).maximise())
    before = max(contender.evidence for contender in alone)
    after = min(beside.evidence, evidence(beside.judged, without)[1])
    assert after > before

    def found(level: float) -> list[str]:
        rounds: list[Round] = []
        monkeypatch.setattr("hapticd.gap.search.critical", lambda blocks, tried: level)
        monkeypatch.setattr("hapticd.gap.search.least_gain", lambda errors: needed)
        search(first, slugs, lambda share, text: None, rounds)
        return [each.taken.slug for each in rounds]

    assert sorted(found(0.5 * (before + after))) == slugs
    assert found(2.0 * after) == []


def test_a_law_that_may_not_be_named_beats_no_other(biased: CrossValidated, monkeypatch: pytest.MonkeyPatch) -> None:
    """What cancels the drive fits anything: it had pushed the true law out before it was refused itself."""
    slugs = ["constant_bias", "gravity", "return_spring"]
    monkeypatch.setattr("hapticd.gap.competition._MOST_FITTED", 1)
    (best,) = compete(biased, slugs, 10.0)
    monkeypatch.setattr("hapticd.gap.competition.keeps_the_drive", lambda fit, present: fit.terms[-1].slug != best.slug)
    (other,) = compete(biased, slugs, 10.0)
    assert other.slug != best.slug


def test_a_law_at_its_limit_is_named_alone_and_only_where_that_closes_its_share(
    biased: CrossValidated, corrected: CrossValidated, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = cross_validate(biased.fit.extended(term("constant_bias", {"tau_0": 1e-6}, (), 0.1)))
    large, tiny = (Contender("constant_bias", judged, 1.0, 9.0) for judged in (corrected, small))

    def may_be_named(is_further: bool) -> list[bool]:
        return [admitted([one], biased, is_further=is_further) == [one] for one in (large, tiny)]

    assert may_be_named(False) == may_be_named(True) == [True, True]
    monkeypatch.setattr(Term, "at_bounds", lambda law, u: [law.coordinates[0].name])
    assert may_be_named(False) == [True, False]
    assert may_be_named(True) == [False, False]


def test_a_law_that_ends_at_a_limit_as_it_is_climbed_gives_way_to_the_next(
    biased: CrossValidated, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hapticd.gap.constants.FORCE_MARGIN", 1.0)
    slugs = ["constant_bias", "asymmetric_coulomb"]
    first, second = (compete(biased, [slug], 0.0)[0] for slug in slugs)
    monkeypatch.setattr("hapticd.gap.search.compete", lambda present, slugs, needed: [first, second])

    def admits(contenders: list[Contender], present: CrossValidated, *, is_further: bool) -> list[Contender]:
        climbed = len(contenders) == 1
        return [one for one in contenders if not (climbed and one.slug == first.slug)]

    monkeypatch.setattr("hapticd.gap.search.admitted", admits)
    monkeypatch.setattr("hapticd.gap.constants.MOST_EFFECTS", 2)
    rounds: list[Round] = []
    search(biased, slugs, lambda share, text: None, rounds)
    assert [each.taken.slug for each in rounds] == [second.slug]


def test_what_a_slow_torque_explains_as_well_makes_nobody_look_back(
    biased: CrossValidated, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That look back had taken a minute of a processor, for a law that was dropped after it."""
    monkeypatch.setattr("hapticd.gap.search._withstands", lambda last, tried: False)
    monkeypatch.setattr("hapticd.gap.search.look_back", lambda *given: pytest.fail("looked back"))
    rounds: list[Round] = []
    search(biased, ["constant_bias"], lambda share, text: None, rounds)
    assert rounds == []


def test_a_small_law_is_named_where_its_model_leaves_nothing_but_chance(hidden: Hidden) -> None:
    """Beside a coloured torque most of what is missing is that torque: a law that is sure had been refused for its size."""
    effect = {"name": "stribeck", "s": 0.27, "omega_s": 3.0}
    recording, model = hidden([effect], 12, 20.0, Coloured(0.25, 0.01))
    first = cross_validate(nominal_fit(problem_of([recording], model)))
    rounds: list[Round] = []
    search(first, ["stribeck", "constant_bias", "quadratic_drag"], lambda share, text: None, rounds)
    assert [each.taken.slug for each in rounds] == ["stribeck"]
    assert not closes(rounds[0].taken.judged.fit, first.fit)


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
    (found,) = candidates(fit, ["encoder_eccentricity"], least_gain(critical(20, 24)))
    assert float(np.exp(found.term.start[0])) == pytest.approx(0.02, rel=0.5)
    assert found.promise == fit.extended(found.term).log_likelihood - fit.log_likelihood
    starts = list(CATALOGUE["encoder_eccentricity"].starts(scale_of(fit)))
    promises = []
    for part in (fit, fit.on(fit.problem.first_look())):
        part.differentiate()
        promises.append(max(Score(part).along(term(found.slug, values, (), 0.1)).promise for values in starts))
    assert found.promise > 2.0 * promises[0] > 100.0 * promises[1]


def test_the_step_of_a_converter_is_found_to_its_spike(hidden: Hidden) -> None:
    """A thousandth beside it hundreds of nats are missing, for which any law may then take the credit."""
    recording, model = hidden([{"name": "dac_quantization", "q": 0.012156}], 1, 10.0)
    present = cross_validate(nominal_fit(problem_of([recording], model)))
    found = round_of(present, compete(present, ["dac_quantization"], least_gain(critical(20, 24))))
    assert float(np.exp(found.taken.law.start[0])) == pytest.approx(0.012156, rel=5e-5)


def test_a_small_law_gives_way_to_one_that_closes_and_gains_more(
    biased: CrossValidated, corrected: CrossValidated, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Coulomb friction that closed nothing had been named for a play that gained seven times as much, in doubt."""
    monkeypatch.setattr("hapticd.gap.search.is_material", lambda better, other: True)
    small, closer = Contender("stribeck", biased, 20.0, 6.0), Contender("constant_bias", corrected, 100.0, 1.0)
    assert closes(corrected.fit, biased.fit)
    assert not _is_right(small, biased, [closer], 4.0)
    assert _is_right(small, biased, [replace(closer, gain=10.0)], 4.0)
    assert not _is_right(replace(small, evidence=3.0), biased, [], 4.0)


def test_what_is_about_as_good_is_climbed_to_the_end_before_it_is_told_apart(
    biased: CrossValidated, corrected: CrossValidated
) -> None:
    """Beside a slow command a lag had been left 15 nats behind the delay that it hardly differs from, and was no rival."""

    def contender(louder: float) -> Contender:
        u = corrected.fit.u.copy()
        u[DISTURBANCE] += louder
        judged = cross_validate(Fit(corrected.fit.problem, corrected.fit.terms, u))
        return Contender("constant_bias", judged, *evidence(judged, biased))

    best, behind, far = contender(0.0), contender(0.2), contender(1.0)
    assert -6.0 < evidence(behind.judged, best.judged)[1] < -3.0
    found = round_of(biased, [best, behind, far])
    assert found.indistinguishable == ("constant_bias",)
    assert evidence(found.contenders[1].judged, found.taken.judged)[1] > -1.0
    assert found.contenders[2] is far
