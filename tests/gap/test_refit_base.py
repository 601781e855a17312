"""Base parameters fitted beside the effects, and the places where the model as given fails."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from hapticd.gap import find_gap
from hapticd.gap.model_file import improved_model

from .conftest import Case


def test_the_base_is_fitted_and_the_effect_still_named(hidden: Callable[..., Case]) -> None:
    effects = [{"name": "inertia_error", "r": 0.1}, {"name": "constant_bias", "tau_0": 2e-4}]
    recording, model = hidden(effects, seed=3, duration_s=8.0)
    slugs = ["inertia_error", "constant_bias", "return_spring", "quadratic_drag"]
    result = find_gap([recording], model, refit_base=True, candidates=slugs)
    assert result.effects == ("constant_bias",)
    assert result.base["inertia"].value == pytest.approx(1.1 * model.plant.inertia, rel=0.01)
    low, high = result.base["coulomb"].ci95
    assert low < result.base["coulomb"].value < high
    assert result.steps[0].parameters["tau_0"].value == pytest.approx(2e-4, rel=0.05)
    improved = improved_model(model, result)
    assert improved.plant.inertia == result.base["inertia"].value
    assert [effect.name for effect in improved.plant.effects] == ["constant_bias"]


def test_where_says_in_which_motion_the_model_fails(hidden: Callable[..., Case]) -> None:
    recording, model = hidden([{"name": "return_spring", "k_s": 2e-3, "theta_0": 0.0}], seed=4, duration_s=8.0)
    result = find_gap([recording], model, candidates=["return_spring"])
    assert result.effects == ("return_spring",)
    coordinates = [place["coordinate"] for place in result.where]
    assert "position" in coordinates
    assert all(0.0 < place["share"] <= 1.0 for place in result.where)
    assert all(place["words"] for place in result.where)
