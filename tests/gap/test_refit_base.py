"""The base model fitted along with what it lacks."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from hapticd.config import Config
from hapticd.gap import find_gap, workflow
from hapticd.gap.base_model import base_terms, problem_of
from hapticd.gap.fit import Fit
from hapticd.gap.problem import Problem

INERTIA, VISCOUS, COULOMB = 6.28e-6, 9.0e-6, 2.0e-3
WRONG = {"inertia_error": 0.25, "viscous_friction": -0.4, "coulomb_friction": 0.1}


def true_base(wrong: dict[str, float]) -> dict[str, float]:
    return {
        "inertia": INERTIA * (1.0 + wrong["inertia_error"]),
        "viscous": VISCOUS * (1.0 + wrong["viscous_friction"]),
        "coulomb": COULOMB * (1.0 + wrong["coulomb_friction"]),
    }


def hidden_as(wrong: dict[str, float]) -> list[dict[str, Any]]:
    return [{"name": slug, "r": r} for slug, r in wrong.items() if r]


def test_a_wrong_base_hides_no_effect(hidden: Callable[..., Any]) -> None:
    """With the base fitted along, its errors are not named, and what comes on top is."""
    effects = [*hidden_as(WRONG), {"name": "constant_bias", "tau_0": 6e-4}]
    recording, model = hidden(effects, 23, 6.0)
    result = find_gap([recording], model, refit_base=True, candidates=None, design=False)
    assert result.effects == ("constant_bias",), result.statement
    for name, true in true_base(WRONG).items():
        assert result.base[name].value == pytest.approx(true, rel=0.02), name


@pytest.mark.parametrize("times", [1.0, 1.0 / 15.0, 15.0, 1.0 / 50.0, 50.0])
def test_a_guess_of_the_inertia_may_be_far_off(hidden: Callable[..., Any], times: float) -> None:
    """An inertia that ran to the end of its range is looked for from there, whatever stood in for it."""
    recording, model = hidden([{"name": "constant_bias", "tau_0": 6e-4}], 23, 6.0)
    slugs = ["constant_bias", "return_spring", "quadratic_drag", "amplifier_lag"]
    result = find_gap([recording], guessed(model, times), refit_base=True, candidates=slugs, design=False)
    assert result.effects == ("constant_bias",), result.statement
    assert "do not tell inertia" not in result.statement
    assert result.base["inertia"].value == pytest.approx(INERTIA, rel=0.02)


def test_what_the_first_search_named_outlives_an_interruption_of_the_second(
    hidden: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def farther(_: Fit, last: Fit) -> Problem:
        monkeypatch.setattr(workflow, "search", interrupted)
        return last.problem

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    recording, model = hidden([{"name": "constant_bias", "tau_0": 6e-4}], 23, 6.0)
    monkeypatch.setattr(workflow, "from_the_end", farther)
    result = find_gap([recording], model, refit_base=True, candidates=["constant_bias"], design=False)
    assert result.interrupted
    assert result.effects == ("constant_bias",)


@pytest.mark.parametrize("times", [1e-3, 1e3])
def test_a_base_that_ends_at_its_limit_is_told(hidden: Callable[..., Any], times: float) -> None:
    recording, model = hidden([], 23, 6.0)
    result = find_gap([recording], guessed(model, times), refit_base=True, candidates=["constant_bias"], design=False)
    assert "do not tell inertia" in result.statement, result.base["inertia"]


def guessed(model: Config, times: float) -> Config:
    plant = model.plant.model_copy(update={"inertia": times * model.plant.inertia})
    return model.model_copy(update={"plant": plant})


def test_friction_takes_no_more_than_the_shaft_gets(hidden: Callable[..., Any]) -> None:
    """Beyond, friction holds the shaft, and a disturbance that is larger than all torques moves it."""
    recording, model = hidden([], 23, 6.0)
    for size in (0.1, 10.0):
        plant = model.plant.model_copy(update={"coulomb": size * COULOMB})
        problem = problem_of([recording], model.model_copy(update={"plant": plant}))
        (friction,) = (item for item in base_terms(problem) if item.slug == "coulomb")
        most = math.exp(friction.coordinates[0].upper)
        assert max(size, 1.0) * COULOMB <= most * (1.0 + 1e-9)
        assert most < max(size, 6.0) * COULOMB * (1.0 + 1e-9)
