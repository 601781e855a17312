"""The base parameters: fitted first, and named where they have left what the model says of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from benchmarks.gap.disturbance import Coloured
from hapticd.config import Config
from hapticd.gap import find_gap
from hapticd.gap.base_model import Balanced, balanced, base_law, known_terms, problem_of
from hapticd.gap.choose import Search
from hapticd.gap.inertia_range import InertiaRange
from hapticd.gap.model_file import improved_model

INERTIA, VISCOUS, COULOMB = 6.28e-6, 9.0e-6, 2.0e-3
WRONG = {"inertia_error": 0.25, "viscous_friction": -0.4, "coulomb_friction": 0.1}


def test_a_wrong_base_hides_no_effect_and_is_named(hidden: Callable[..., Any]) -> None:
    effects = [{"name": "constant_bias", "tau_0": 6e-4}, *({"name": slug, "r": r} for slug, r in WRONG.items())]
    recording, model = hidden(effects, 23, 6.0)
    result = find_gap([recording], model, design=False)
    assert set(result.effects) == {"constant_bias", *WRONG}, result.statement
    found = {step.effect: step.parameters for step in result.steps}
    for slug, r in WRONG.items():
        assert found[slug]["r"].value == pytest.approx(r, abs=0.01), slug
    plant = improved_model(model, result).plant
    assert plant.inertia == pytest.approx(1.25 * INERTIA, rel=0.01)
    assert plant.viscous == pytest.approx(0.6 * VISCOUS, rel=0.02)
    assert plant.coulomb == pytest.approx(1.1 * COULOMB, rel=0.01)
    assert result.base["inertia"].value == pytest.approx(plant.inertia)


def test_base_parameters_that_are_a_little_wrong_are_no_friction_law(hidden: Callable[..., Any]) -> None:
    """Viscous friction wrong by 5 % and Coulomb friction by 2 %, each unsure by itself, had been named Stribeck friction."""
    ripple = {"name": "torque_ripple", "orders": [7.0], "amplitudes": [8e-4], "phases": [0.3]}
    wrong = [{"name": "viscous_friction", "r": 0.05}, {"name": "coulomb_friction", "r": -0.02}]
    recording, model = hidden([ripple, *wrong], 3, 6.0, Coloured(0.05, 0.05))
    slugs = ["torque_ripple", "stribeck", "quadratic_drag", "viscous_friction", "coulomb_friction", "inertia_error"]
    result = find_gap([recording], model, candidates=slugs, design=False)
    assert "torque_ripple" in result.effects
    assert {"stribeck", "quadratic_drag"}.isdisjoint(result.effects), result.statement
    (unsure,) = (warning for warning in result.recording["warnings"] if "the data are likelier with" in warning)
    assert "instead of 0.002 N m" in unsure
    assert "the improved model does not have it" in unsure


@pytest.mark.parametrize("times", [1.0 / 15.0, 15.0, 1.0 / 50.0, 50.0])
def test_a_guess_of_the_inertia_may_be_far_off(hidden: Callable[..., Any], times: float) -> None:
    """The climb begins from the balance of forces too."""
    recording, model = hidden([{"name": "constant_bias", "tau_0": 6e-4}], 23, 6.0)
    slugs = ["constant_bias", "return_spring", "quadratic_drag", "amplifier_lag"]
    result = find_gap([recording], guessed(model, times), refit_base=True, candidates=slugs, design=False)
    assert set(result.effects) == {"constant_bias", "inertia_error"}, result.statement
    assert result.base["inertia"].value == pytest.approx(INERTIA, rel=0.02)


def test_a_guess_that_the_balance_denies_is_the_error_of_an_inertia(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 23, 6.0)
    for times in (1e-3, 1e3):
        guess = guessed(model, times)
        assert balanced([recording], guess).values["inertia_error"] == pytest.approx(INERTIA, rel=0.2)
        result = find_gap([recording], guess, refit_base=True, candidates=["constant_bias"], design=False)
        assert result.base["inertia"].value == pytest.approx(INERTIA, rel=0.02)


def test_what_the_model_is_unsure_of_is_fitted_and_not_named(hidden: Callable[..., Any]) -> None:
    """A tenth off, and known to a tenth: that is no error."""
    recording, model = hidden([{"name": "constant_bias", "tau_0": 6e-4}], 23, 6.0)
    off = guessed(model, 1.1)
    unsure = off.plant.uncertainty.model_copy(update={"inertia": 0.1 * INERTIA})
    unsure_model = off.model_copy(update={"plant": off.plant.model_copy(update={"uncertainty": unsure})})
    (known,) = known_terms(problem_of([recording], unsure_model), unsure_model)
    assert (known.slug, known.coordinates[0].prior) == ("inertia", pytest.approx(0.1 / 1.1))
    assert find_gap([recording], unsure_model, design=False).effects == ("constant_bias",)
    assert set(find_gap([recording], off, design=False).effects) == {"constant_bias", "inertia_error"}


@pytest.mark.parametrize("is_known", [False, True])
def test_a_balance_holds_no_inertia_that_the_config_is_sure_of(hidden: Callable[..., Any], is_known: bool) -> None:
    """A late device makes the inertia of the balance too large: here it says ten times the true one, and no force left."""
    recording, model = hidden([{"name": "constant_bias", "tau_0": 6e-4}], 23, 6.0)
    uncertainty = model.plant.uncertainty.model_copy(update={"inertia": 0.05 * INERTIA if is_known else 0.0})
    model = model.model_copy(update={"plant": model.plant.model_copy(update={"uncertainty": uncertainty})})
    problem = problem_of([recording], model)
    denied = Balanced({"inertia_error": 10.0 * INERTIA}, InertiaRange(9.0 * INERTIA, 11.0 * INERTIA, 0.0))
    search = Search(problem, ("inertia_error", "constant_bias"), known_terms(problem, model), denied)
    free = search.base.first()
    assert free is not None
    assert denied.contradicts(free.fit)
    first = search.base.held(free)
    assert (first is free) == is_known
    assert not (is_known and search.base.is_held)


def guessed(model: Config, times: float) -> Config:
    plant = model.plant.model_copy(update={"inertia": times * model.plant.inertia})
    return model.model_copy(update={"plant": plant})


def test_friction_takes_no_more_than_the_shaft_gets(hidden: Callable[..., Any]) -> None:
    """Beyond, friction holds the shaft, and a disturbance that is larger than all torques moves it."""
    recording, model = hidden([], 23, 6.0)
    for size in (0.1, 10.0):
        plant = model.plant.model_copy(update={"coulomb": size * COULOMB})
        problem = problem_of([recording], model.model_copy(update={"plant": plant}))
        most = math.exp(base_law(problem, "coulomb_friction").coordinates[0].upper)
        assert max(size, 1.0) * COULOMB <= most * (1.0 + 1e-9)
        assert most < max(size, 6.0) * COULOMB * (1.0 + 1e-9)
