"""Every effect of the catalogue, hidden by the benchmark's independent integrator, is named; then nothing is missing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.gap import recipes
from benchmarks.gap.disturbance import Coloured
from benchmarks.gap.hidden import LAWS
from benchmarks.gap.plan import exact_class
from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import find_gap
from hapticd.gap.base_model import problem_of
from hapticd.gap.candidates import candidates
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.result import GapResult

SEED = 1
SECONDS = 6.0
LONGER = {"torque_ripple": 10.0, "hand_impedance": 10.0, "dropped_samples": 8.0, "backlash": 10.0}
LONGER["asymmetric_coulomb"] = 10.0
SHORTCOMINGS = {"asymmetric_coulomb": 6.0, "backlash": 6.0, "dropped_samples": 10.0}
"""Effects, with the length of a recording, that are not found in it, or not wholly, though they are plainly there."""
COLOURED = ("inertia_error", "coulomb_friction", "constant_bias", "gravity", "transport_delay", "encoder_eccentricity")
NULLS = [Coloured(share, correlation_s) for share in (0.05, 0.25) for correlation_s in (0.01, 0.2)]

Hidden = Callable[..., Any]


def plain(slug: str, duration_s: float) -> dict[str, Any]:
    """The effect at the benchmark's full strength."""
    scale = recipes.scale_of("re35", SEED, duration_s)
    return recipes.draw(slug, scale, np.random.default_rng([SEED, 7]))(1.0)


def find(hidden: Hidden, effects: list[dict[str, Any]], duration_s: float, coloured: Coloured | None) -> GapResult:
    recording, model = hidden(effects, SEED, duration_s, coloured)
    return find_gap([recording], model, design=False)


def names_it(result: GapResult, slug: str) -> bool:
    """The first name is the effect, or one that is the same law and says so."""
    if not result.effects:
        return False
    first = result.steps[0]
    return first.effect == slug or (first.effect in exact_class(slug) and slug in first.indistinguishable_from)


def test_every_effect_is_hidden_somewhere() -> None:
    assert set(LAWS) == set(CATALOGUE)
    assert set(SHORTCOMINGS) <= set(LAWS)


@pytest.mark.parametrize("slug", LAWS)
def test_a_plain_effect_is_named(hidden: Hidden, slug: str) -> None:
    duration_s = LONGER.get(slug, SECONDS)
    result = find(hidden, [plain(slug, duration_s)], duration_s, None)
    assert names_it(result, slug), result.statement
    assert len(result.effects) == 1, result.statement
    assert result.verdict in ("effect_found", "partly_explained")
    assert result.gap.held_out_after < 0.5 * result.gap.held_out_before
    assert result.gap.train_after < 0.5 * result.gap.train_before
    assert result.steps[0].evidence > float(result.details["needed_standard_errors"])
    assert result.prediction["k_step"]["after"] < result.prediction["k_step"]["before"]


def test_a_play_whose_contact_is_a_spring_is_named_with_its_stiffness(hidden: Hidden) -> None:
    """Without the spring in the law it was a coupling with Stribeck friction, of 19 and 15 standard errors."""
    play = {"name": "backlash", "gap": 0.02, "load_share": 0.4, "stiffness": 2.0, "damping": 2e-4}
    result = find(hidden, [play], 10.0, None)
    assert [step.effect for step in result.steps] == ["backlash"], result.statement
    assert result.verdict == "effect_found"
    (found,) = result.steps
    assert found.parameters["stiffness"].value == pytest.approx(2.0, rel=0.2)
    assert found.parameters["gap"].value == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("slug", SHORTCOMINGS)
def test_what_is_not_found_is_not_taken_for_something_else(hidden: Hidden, slug: str) -> None:
    result = find(hidden, [plain(slug, SHORTCOMINGS[slug])], SHORTCOMINGS[slug], None)
    assert names_it(result, slug) or result.verdict != "effect_found", result.statement


@pytest.mark.parametrize("slug", COLOURED)
def test_it_is_named_beside_a_torque_that_no_catalogue_knows(hidden: Hidden, slug: str) -> None:
    coloured = Coloured(0.05, 0.05)
    result = find(hidden, [plain(slug, SECONDS)], SECONDS, coloured)
    assert names_it(result, slug), result.statement
    assert len(result.effects) == 1, result.statement
    assert result.gap.held_out_after < 0.6 * result.gap.held_out_before
    # What is left is the torque: no law may take it away.
    assert result.gap.held_out_after > 0.3 * coloured.share * 2e-3


@pytest.mark.parametrize("coloured", NULLS, ids=[f"{c.share:.0%} of friction, {c.correlation_s} s" for c in NULLS])
def test_such_a_torque_alone_is_no_effect(hidden: Hidden, coloured: Coloured) -> None:
    result = find(hidden, [], SECONDS, coloured)
    assert result.effects == ()
    assert result.verdict == "no_missing_effect", result.statement
    assert "no effect is missing" in result.statement.lower()


@pytest.mark.parametrize("seed", [1, 2])
def test_motion_that_such_a_torque_has_made_is_no_cause_of_it(hidden: Hidden, seed: int) -> None:
    recording, model = hidden([], seed, 2.0 * SECONDS, Coloured(0.25, 0.01))
    result = find_gap([recording], model, candidates=["constant_bias"], design=False)
    assert result.remainder.structure == (), result.statement


def test_a_device_as_its_model_has_nothing_missing(hidden: Hidden) -> None:
    result = find(hidden, [], SECONDS, None)
    assert result.verdict == "no_missing_effect", result.statement
    assert result.gap.held_out_before < 0.02 * 2e-3


@pytest.mark.parametrize("stiffness", [0.005, 0.1])
def test_a_spring_may_be_stronger_than_all_other_torques(hidden: Hidden, stiffness: float) -> None:
    """Twice and ten times what begins as large as they are together, and no more than a twentieth of that."""
    recording, model = hidden([{"name": "return_spring", "k_s": stiffness, "theta_0": 0.1}], 23, SECONDS)
    found = find_gap([recording], model, candidates=["return_spring"], design=False)
    assert found.verdict == "effect_found", found.statement
    assert found.steps[0].parameters["k_s"].value == pytest.approx(stiffness, rel=2e-3)


def test_a_limit_that_is_reached_but_once_is_found(hidden: Hidden) -> None:
    """14 samples of 8000, none of them where the first look goes."""
    recording, model = hidden([{"name": "current_saturation", "i_max": 0.8886}], 2, 8.0)
    problem = problem_of([recording], model)
    assert np.abs(problem.subsample().series.command).max() < 0.8886 < np.abs(problem.series.command).max()
    (limit,) = candidates(nominal_fit(problem), ["current_saturation"], 9.0)
    assert np.exp(limit.term.start[0]) == pytest.approx(0.8886, rel=0.03)
