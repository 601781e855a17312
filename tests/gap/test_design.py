"""The designed experiment: within the limits, and it really tells apart what the data before could not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hapticd.config import Config, load_config, parse_config
from hapticd.gap import constants, find_gap
from hapticd.gap import options as experiments
from hapticd.gap.base_model import base_law, problem_of
from hapticd.gap.choose import Named
from hapticd.gap.design import next_experiment, pairs
from hapticd.gap.fit import Fit
from hapticd.gap.law_set import Comparison, LawSet
from hapticd.gap.model_file import with_effects
from hapticd.gap.recording import Recording
from hapticd.gap.terms import BASE_WORDS, term
from hapticd.gap.trial import CompetingModel, competing_model, play, separation
from hapticd.servo.excitation import build
from hapticd.servo.experiment import Experiment, experiment_of, read_experiment

MODEL = parse_config({}, "model")
PULL, ANGLE = 5e-4, 1.0
STILL = Experiment("steps", amplitude=0.09, duration_s=4.0)
"""Hardly above the breakaway: the shaft turns a little, and a weight pulls as a constant does."""
LAWS: dict[str, dict[str, float]] = {
    "gravity": {"m_g_l": PULL, "theta_0": ANGLE},
    "constant_bias": {"tau_0": PULL * np.sin(ANGLE)},
}
NOISE = np.log([1e-6, 1e-4, 5e-5, 0.03, 1e-7])
"""White 1 µN m √s, sensor 0.1 mrad, and a disturbance of 50 µN m over 30 ms."""


def device(slug: str) -> Config:
    return with_effects(MODEL, [(slug, LAWS[slug])])


@pytest.fixture(scope="module")
def still() -> Recording:
    recording = play(device("gravity"), STILL)
    assert recording is not None
    return recording


def law_set(recording: Recording, slug: str, *, base: Any = (), **values: float) -> LawSet:
    fit = Fit.started(problem_of([recording], MODEL), (*base, term(slug, values or LAWS[slug], (), 0.1)), NOISE)
    return LawSet(fit, np.zeros(fit.problem.series.blocks))


def open_between(slug: str, *ties: LawSet) -> list[Named]:
    return [Named(slug, Comparison(True, "", 40.0, 8.0, 0.1), ties, ())]


@pytest.fixture(scope="module")
def planned(still: Recording) -> tuple[dict[str, Any], list[float]]:
    shares: list[float] = []
    gravity, bias = (law_set(still, slug) for slug in LAWS)
    named = open_between("gravity", bias)
    plan = next_experiment(MODEL, gravity, named, lambda share, what: shares.append(share))
    assert plan is not None
    return plan, shares


@pytest.fixture(scope="module")
def models(still: Recording) -> list[CompetingModel]:
    found = []
    for slug in LAWS:
        one = competing_model(MODEL, law_set(still, slug).fit)
        assert one is not None
        found.append(one)
    return found


def test_the_plan_separates_what_a_still_shaft_does_not(
    planned: tuple[dict[str, Any], list[float]], models: list[CompetingModel]
) -> None:
    plan, shares = planned
    assert plan["separates"] == ["gravity", "constant_bias"]
    before = separation(STILL, pairs(models))
    assert before is not None
    assert before < 0.7 * plan["expected"]
    assert plan["expected"] > constants.INDISTINGUISHABLE
    assert f"expected separation of gravity and constant_bias: {plan['expected']:.1f} standard errors" in plan["words"]
    assert "these data: 0.0" in plan["words"]
    assert shares == sorted(shares)
    assert shares[-1] <= 1.0


def test_the_plan_is_what_excite_runs(planned: tuple[dict[str, Any], list[float]], tmp_path: Path) -> None:
    plan = planned[0]
    path = tmp_path / plan["file"]
    path.write_text(yaml.safe_dump(plan["experiment"]))
    experiment = read_experiment(path)
    assert build(MODEL, experiment.excitation, **experiment.plan()).shape[1] > 0
    for slug in LAWS:
        assert play(device(slug), experiment) is not None


@pytest.mark.parametrize(("true", "other"), [("gravity", "constant_bias"), ("constant_bias", "gravity")])
def test_the_planned_experiment_names_the_true_one(
    planned: tuple[dict[str, Any], list[float]], true: str, other: str
) -> None:
    recording = play(device(true), experiment_of(planned[0]["experiment"], "plan"))
    assert recording is not None
    found = find_gap([recording], MODEL, candidates=[true, other], design=False)
    assert found.effects[0] == true
    assert other not in found.steps[0].indistinguishable_from


def test_what_one_law_can_absorb_does_not_count(models: list[CompetingModel]) -> None:
    """A bias a little larger is no other law, unless the data at hand know it well."""
    bias = models[1]
    larger = replace(bias, terms=(bias.terms[0].moved([1.05 * bias.terms[0].start[0]]),))
    experiment = Experiment("steps", amplitude=0.3, duration_s=4.0)
    known = separation(experiment, [(bias, larger)])
    free = separation(experiment, [(bias, replace(larger, known=np.zeros_like(larger.known)))])
    assert known is not None
    assert free is not None
    assert free < 0.3 * known


def test_twins_cannot_be_separated_and_the_plan_says_so(still: Recording) -> None:
    bias = law_set(still, "constant_bias")
    twin = law_set(still, "asymmetric_coulomb", a=-LAWS["constant_bias"]["tau_0"] / MODEL.plant.coulomb)
    plan = next_experiment(MODEL, bias, open_between("constant_bias", twin), lambda share, what: None)
    assert plan is not None
    assert plan["expected"] < 0.5
    assert (plan["experiment"], plan["file"]) == (None, None)
    assert "no experiment within the limits distinguishes" in plan["words"]
    assert "prefer the simpler law, constant_bias" in plan["words"]


def test_where_nothing_may_move_the_simpler_law_is_preferred(still: Recording) -> None:
    held = MODEL.model_copy(update={"safety": MODEL.safety.model_copy(update={"max_excursion": 1e-4})})
    gravity, bias = (law_set(still, slug) for slug in LAWS)
    plan = next_experiment(held, gravity, open_between("gravity", bias), lambda share, what: None)
    assert plan is not None
    assert (plan["expected"], plan["experiment"]) == (None, None)
    assert "No experiment within the limits" in plan["words"]
    assert "prefer the simpler law, constant_bias" in plan["words"]


def test_what_is_not_ambiguous_needs_no_experiment(still: Recording) -> None:
    gravity = law_set(still, "gravity")
    assert next_experiment(MODEL, gravity, open_between("gravity"), lambda share, what: None) is None


def test_all_laws_of_a_set_belong_to_the_device(still: Recording) -> None:
    base = [base_law(problem_of([still], MODEL), slug) for slug in BASE_WORDS]
    heavier = base[0].moved([base[0].start[0] + np.log(1.2)])
    fit = law_set(still, "constant_bias", base=[heavier, *base[1:]]).fit
    fit = fit.extended(term("transport_delay", {"t_d": 1e-3}, (), 0.1))
    found = competing_model(MODEL, fit)
    assert found is not None
    assert [effect.name for effect in found.config.plant.effects] == ["constant_bias", "transport_delay"]
    assert found.config.plant.inertia == pytest.approx(1.2 * MODEL.plant.inertia)
    assert found.known.shape == (len(base) + 2, len(base) + 2)


def test_a_hand_lets_go_before_the_experiment(still: Recording) -> None:
    hand = term("hand_impedance", {"m_h": 1e-6, "on_s": 1.0, "off_s": 2.0}, ("on_s", "off_s"), 0.1)
    fit = Fit.started(problem_of([still], MODEL), (hand,), NOISE)
    found = competing_model(MODEL, fit)
    assert found is not None
    assert (found.terms, found.config.plant.effects) == ((), ())


@pytest.mark.parametrize("preset", ["re35", "omega", "phantom"])
def test_every_option_is_admitted_by_the_limits(preset: str) -> None:
    config = load_config(preset)
    options = experiments.shapes(config)
    assert {option.excitation for option in options} == {"ramp", "sweep", "chirp", "steps", "release"}
    for option in options:
        if option.excitation != "sweep":  # which may be too fast for the speed limit, and is left out then
            assert build(config, option.excitation, **option.plan()).shape[1] > 0
    changed = [key for option in experiments.with_settings(config, options[0]) for key in option.settings]
    assert "spring.stiffness" in changed


def test_a_trial_that_would_trip_is_no_option() -> None:
    def limited(speed: float) -> Config:
        return MODEL.model_copy(update={"safety": MODEL.safety.model_copy(update={"max_velocity": speed})})

    experiment = Experiment("chirp", amplitude=0.3, duration_s=3.0)
    free = play(limited(400.0), experiment)
    assert free is not None
    top = float(np.abs(np.diff(free.position)).max() / free.period_s)
    assert play(limited(1.2 * top), experiment) is None
    assert play(limited(2.0 * top), experiment) is not None


def test_what_cannot_be_played_is_no_option() -> None:
    assert play(MODEL, Experiment("chirp", amplitude=99.0)) is None
    assert play(MODEL, Experiment("chirp", amplitude=1e-3, duration_s=2.0)) is None
    assert play(MODEL, replace(STILL, settings={"spring.stiffness": -1.0})) is None
