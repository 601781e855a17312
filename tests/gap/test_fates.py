"""Fates of commands: on a free mass whose losses are known, and in the workflow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hapticd.gap import find_gap
from hapticd.gap.candidates.fates import Fates, Shaft, effective, find

if TYPE_CHECKING:
    from collections.abc import Callable

LENGTH, PUSH = 30, 20.0


def of_free_mass(probability: float, windows: int, push: float, seed: int) -> tuple[np.ndarray, Fates]:
    """Losses drawn for a mass that moves under random commands, and what is found in noise of unit size."""
    rng = np.random.default_rng(seed)
    command = rng.normal(size=(windows, LENGTH)).cumsum(axis=1)
    lost = rng.random(command.shape) < probability
    lost[:, 0] = False
    in_force = np.array([effective(*row) for row in zip(command, lost, strict=True)])
    kick = push * (in_force - command)
    speed = np.cumsum(kick, axis=1)
    residual = np.cumsum(speed - 0.5 * kick, axis=1) + rng.normal(size=command.shape)
    shaft = Shaft(1.0, np.full(command.shape, push))
    return lost, find(residual, shaft, command, command, command[:, 0], probability)


def test_clear_losses_are_found_tick_by_tick() -> None:
    lost, found = of_free_mass(0.1, 40, PUSH, 1)
    assert np.mean(found.lost[:, 1:] == lost[:, 1:]) > 0.99
    assert found.number.sum() == pytest.approx(lost.sum(), abs=8)


def test_what_cannot_be_seen_costs_nothing_and_stays_open() -> None:
    _, found = of_free_mass(0.3, 40, 0.0, 2)
    assert found.price == pytest.approx(0.0, abs=1e-6)
    assert found.number == pytest.approx(0.3 * LENGTH)
    assert found.spread == pytest.approx(0.3 * 0.7 * LENGTH)


@pytest.mark.parametrize("push", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("probability", [0.15, 0.45])
def test_losses_that_show_little_are_counted_without_bias(probability: float, push: float) -> None:
    lost, found = of_free_mass(probability, 400, push, 1)
    # The first tick cannot be told, and counts with its prior.
    expected = lost[:, 1:].mean() * (LENGTH - 1) + probability
    assert found.number.mean() == pytest.approx(expected, rel=0.03)


def test_a_clear_choice_costs_its_prior() -> None:
    lost, found = of_free_mass(0.1, 40, PUSH, 3)
    right = (found.lost == lost).all(axis=1)
    number = lost.sum(axis=1)
    prior = -2.0 * (number * np.log(0.1) + (LENGTH - number) * np.log(0.9))
    # One tick cannot be told: the first, before which the current was the same.
    assert found.price[right] == pytest.approx(prior[right] + 2.0 * np.log(0.9), abs=1.0)


@pytest.mark.parametrize(("probability", "seed"), [(0.15, 4), (0.5, 3)])
def test_lost_commands_are_named_however_many(hidden: Callable[..., Any], probability: float, seed: int) -> None:
    recording, model = hidden([{"name": "dropped_samples", "p": probability}], seed)
    result = find_gap(
        [recording], model, candidates=("dropped_samples", "transport_delay", "amplifier_lag", "torque_constant_error")
    )
    assert (result.verdict, result.effects) == ("effect_found", ("dropped_samples",))
    low, high = result.steps[0].parameters["p"].ci95
    assert low - 0.02 < probability < high + 0.02


def test_a_slow_current_loop_is_named(hidden: Callable[..., Any]) -> None:
    """Slower than a window is long."""
    recording, model = hidden([{"name": "amplifier_lag", "f_a": 12.0, "delta": 0.6}], 5)
    result = find_gap([recording], model, candidates=("transport_delay", "amplifier_lag", "inertia_error"))
    assert (result.verdict, result.effects) == ("effect_found", ("amplifier_lag",))
    assert result.steps[0].parameters["f_a"].value == pytest.approx(12.0, rel=0.02)
