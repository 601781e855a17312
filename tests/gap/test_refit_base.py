"""The base model fitted along with what it lacks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from hapticd.gap import find_gap

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
