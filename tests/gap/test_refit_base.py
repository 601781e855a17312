"""The base model fitted along with what it lacks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hapticd.gap import find_gap
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.workflow import base_terms, problem_of

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


@pytest.mark.parametrize(("heavier", "rougher"), [(9.0, 1.0 / 9.0), (1.0 / 9.0, 9.0)])
def test_a_guess_far_off_is_found_from_another_start(
    hidden: Callable[..., Any], heavier: float, rougher: float
) -> None:
    """From the guess alone a climb on a real motor had ended 20,000 nats below the maximum, at the lightest shaft."""
    recording, model = hidden([], 23, 6.0)
    plant = model.plant.model_copy(update={"inertia": heavier * INERTIA, "coulomb": rougher * COULOMB})
    problem = problem_of([recording], model.model_copy(update={"plant": plant}))
    fit = nominal_fit(problem, base_terms(problem))
    assert [item.slug for item in fit.terms] == ["inertia", "viscous", "coulomb"]
    assert np.exp(fit.u[-3:]) == pytest.approx([INERTIA, VISCOUS, COULOMB], rel=0.01)
