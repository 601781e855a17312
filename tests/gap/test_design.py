"""The designed experiment: within the limits, and it really tells apart what the data before could not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hapticd.config import Config, parse_config
from hapticd.gap import find_gap
from hapticd.gap import options as experiments
from hapticd.gap.candidates.build import Scalar, scalar_term
from hapticd.gap.design import next_experiment
from hapticd.gap.hypothesis import Hypothesis
from hapticd.gap.rivals import Rival, pairs
from hapticd.gap.ties import RESOLVED
from hapticd.gap.trial import play, separation
from hapticd.plant.layout import device_vector
from hapticd.servo.excitation import build
from hapticd.servo.experiment import Experiment, experiment_of, read_experiment

MODEL = parse_config({}, "model")
PULL, ANGLE = 5e-4, 1.0
STILL = Experiment("steps", amplitude=0.09, duration_s=4.0)
"""Hardly above the breakaway: the shaft turns a little, and a weight pulls as a constant does."""


def claim(slug: str, **values: float) -> Rival:
    limits = {"m_g_l": 1e-2, "theta_0": 3.0, "tau_0": 1e-2}
    term = scalar_term(slug, *(Scalar(name, value, -limits[name], limits[name]) for name, value in values.items()))
    config = parse_config({"plant": {"effects": [{"name": slug, **values}]}}, slug)
    return Rival(slug, Hypothesis(device_vector(MODEL), (term,)), np.array(term.start), config)


WEIGHT, CONSTANT = claim("gravity", m_g_l=PULL, theta_0=ANGLE), claim("constant_bias", tau_0=PULL * np.sin(ANGLE))


@pytest.fixture(scope="module")
def planned() -> tuple[dict[str, Any], list[float]]:
    shares: list[float] = []
    plan = next_experiment(MODEL, [WEIGHT, CONSTANT], 0.0, 0.8, lambda share, what: shares.append(share))
    assert plan is not None
    return plan, shares


def test_the_plan_separates_what_a_still_shaft_does_not(planned: tuple[dict[str, Any], list[float]]) -> None:
    plan, shares = planned
    assert plan["separates"] == ["gravity", "constant_bias"]
    still = separation(STILL, pairs([WEIGHT, CONSTANT]), 0.0)
    assert still is not None
    assert still < 0.7 * plan["expected"]
    assert plan["expected"] > RESOLVED
    assert f"expected separation of gravity and constant_bias: {plan['expected']:.1f} standard errors" in plan["words"]
    assert "these data: 0.8" in plan["words"]
    assert shares == sorted(shares)


def test_the_plan_is_what_excite_runs(planned: tuple[dict[str, Any], list[float]], tmp_path: Path) -> None:
    plan = planned[0]
    path = tmp_path / plan["file"]
    path.write_text(yaml.safe_dump(plan["experiment"]))
    experiment = read_experiment(path)
    assert build(MODEL, experiment.excitation, **experiment.plan()).shape[1] > 0
    for rival in (WEIGHT, CONSTANT):
        assert play(rival.config, experiment, 0.0) is not None


def test_the_planned_experiment_names_the_true_one(planned: tuple[dict[str, Any], list[float]]) -> None:
    experiment = experiment_of(planned[0]["experiment"], "plan")
    for true, other in ((WEIGHT, CONSTANT), (CONSTANT, WEIGHT)):
        recording = play(true.config, experiment, 0.0, seed=5)
        assert recording is not None
        found = find_gap([recording], MODEL, candidates=[true.slug, other.slug], design=False)
        ranking = {ranked.effect: ranked.behind for ranked in found.steps[0].ranking}
        assert found.effects[0] == true.slug
        assert ranking.get(other.slug, np.inf) > RESOLVED


def test_twins_cannot_be_separated_and_the_plan_says_so() -> None:
    plan = next_experiment(MODEL, [CONSTANT, replace(CONSTANT, slug="twin")], 0.0, 0.0, lambda share, what: None)
    assert plan is not None
    assert plan["expected"] < 0.5
    assert (plan["experiment"], plan["file"]) == (None, None)
    assert "the same device" in plan["words"]


def test_one_claim_needs_no_experiment() -> None:
    assert next_experiment(MODEL, [CONSTANT], 0.0, 0.0, lambda share, what: None) is None


@pytest.mark.parametrize("preset", ["re35", "omega", "phantom"])
def test_every_option_is_admitted_by_the_limits(preset: str) -> None:
    from hapticd.config import load_config

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
    free = play(limited(400.0), experiment, 0.0)
    assert free is not None
    top = float(np.abs(np.diff(free.position)).max() / free.period_s)
    assert play(limited(1.2 * top), experiment, 0.0) is None
    assert play(limited(2.0 * top), experiment, 0.0) is not None


def test_what_cannot_be_played_is_no_option() -> None:
    assert play(MODEL, Experiment("chirp", amplitude=99.0), 0.0) is None
    assert play(MODEL, Experiment("chirp", amplitude=1e-3, duration_s=2.0), 0.0) is None
    assert play(MODEL, replace(STILL, settings={"spring.stiffness": -1.0}), 0.0) is None


def test_a_trial_has_the_noise_that_is_asked_for() -> None:
    quiet, noisy = play(MODEL, STILL, 0.0), play(MODEL, STILL, 1e-3, seed=2)
    assert quiet is not None
    assert noisy is not None
    assert np.std(noisy.position - quiet.position) == pytest.approx(1e-3, rel=0.05)
