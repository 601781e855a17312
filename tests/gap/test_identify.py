"""Inertia and friction from recordings, with intervals that hold the truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from benchmarks.gap.disturbance import Coloured
from hapticd.gap import find_gap
from hapticd.gap.workflow import identify

INERTIA, VISCOUS, COULOMB = 6.28e-6, 9.0e-6, 2.0e-3
WRONG = {
    "all": {"inertia_error": 0.25, "viscous_friction": -0.4, "coulomb_friction": 0.1},
    "inertia": {"inertia_error": -0.3, "viscous_friction": 0.0, "coulomb_friction": 0.0},
    "friction": {"inertia_error": 0.0, "viscous_friction": 0.4, "coulomb_friction": -0.2},
}


def true_base(wrong: dict[str, float]) -> dict[str, float]:
    return {
        "inertia": INERTIA * (1.0 + wrong["inertia_error"]),
        "viscous": VISCOUS * (1.0 + wrong["viscous_friction"]),
        "coulomb": COULOMB * (1.0 + wrong["coulomb_friction"]),
    }


def hidden_as(wrong: dict[str, float]) -> list[dict[str, Any]]:
    return [{"name": slug, "r": r} for slug, r in wrong.items() if r]


@pytest.mark.parametrize("which", WRONG)
def test_base_parameters_are_recovered(hidden: Callable[..., Any], which: str) -> None:
    recording, model = hidden(hidden_as(WRONG[which]), 16, 8.0)
    found = identify([recording], model)
    for name, true in true_base(WRONG[which]).items():
        assert found[name].value == pytest.approx(true, rel=0.02), name
        assert found[name].unit


@pytest.mark.parametrize("seed", [17, 18, 19])
def test_intervals_hold_the_truth_beside_a_coloured_torque(hidden: Callable[..., Any], seed: int) -> None:
    """To one and a half half-widths: of nine intervals of 95 % one may well miss."""
    recording, model = hidden(hidden_as(WRONG["all"]), seed, 8.0, Coloured(0.05, 0.05))
    found = identify([recording], model)
    for name, true in true_base(WRONG["all"]).items():
        low, high = found[name].ci95
        assert low < found[name].value < high
        assert high / low < 2.0, name
        assert true * (low / found[name].value) ** 0.5 < high, name
        assert low < true * (high / found[name].value) ** 0.5, name


def test_two_recordings_tell_more_than_one(hidden: Callable[..., Any]) -> None:
    wrong = WRONG["all"]
    (one, model), (two, _) = (hidden(hidden_as(wrong), seed, 6.0, Coloured(0.05, 0.05)) for seed in (21, 22))
    alone, both = identify([one], model), identify([one, two], model)
    for name, true in true_base(wrong).items():
        assert both[name].value == pytest.approx(true, rel=0.25), name
    widths = [sum(e.ci95[1] / e.ci95[0] for e in found.values()) for found in (alone, both)]
    assert widths[1] < widths[0]


def test_a_wrong_base_hides_no_effect(hidden: Callable[..., Any]) -> None:
    """With the base fitted along, its errors are not named, and what comes on top is."""
    effects = [*hidden_as(WRONG["all"]), {"name": "constant_bias", "tau_0": 6e-4}]
    recording, model = hidden(effects, 23, 6.0)
    result = find_gap([recording], model, refit_base=True, candidates=None, design=False)
    assert result.effects == ("constant_bias",), result.statement
    for name, true in true_base(WRONG["all"]).items():
        assert result.base[name].value == pytest.approx(true, rel=0.02), name
