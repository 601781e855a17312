"""The missing force: how large, where, how much of it could be explained, and what noise alone reads."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.gap.disturbance import Coloured
from hapticd.gap import constants, missing
from hapticd.gap.base_model import base_law, problem_of
from hapticd.gap.fit import Fit
from hapticd.gap.law_set import is_better, scored
from hapticd.gap.lines import lines
from hapticd.gap.missing import (
    dependences,
    explainable,
    hats,
    held_out_rms,
    missing_force,
    missing_power,
    noise_floor,
    since_reversal,
    structure,
)
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.remainder import remainder_of
from hapticd.gap.terms import Term, term
from hapticd.gap.unnamed import with_function

GRAVITY = {"name": "gravity", "m_g_l": 6e-4, "theta_0": 0.3}


@pytest.fixture(scope="module")
def with_gravity(hidden: Callable[..., Any]) -> Fit:
    recording, model = hidden([GRAVITY], 8, 8.0, Coloured(0.05, 0.05))
    fit = nominal_fit(problem_of([recording], model))
    fit.held_out()
    return fit


@pytest.fixture(scope="module")
def noise_alone(hidden: Callable[..., Any]) -> Fit:
    recording, model = hidden([], 8, 8.0, Coloured(0.25, 0.05))
    fit = nominal_fit(problem_of([recording], model))
    fit.held_out()
    return fit


def test_a_hidden_gravity_is_read_sample_by_sample(with_gravity: Fit) -> None:
    found = missing_force(with_gravity)
    true = -GRAVITY["m_g_l"] * np.sin(found.position - GRAVITY["theta_0"])
    moves = found.moves
    assert np.corrcoef(found.force[moves], true[moves])[0, 1] > 0.9
    assert found.rms == pytest.approx(float(np.sqrt(np.mean(true[moves] ** 2))), rel=0.25)
    assert missing_power(with_gravity) == pytest.approx(found.rms**2)
    assert np.all(found.power[~moves] == 0.0)


def test_it_is_a_function_of_the_position(with_gravity: Fit) -> None:
    found = missing_force(with_gravity)
    entries = {entry.coordinate: entry.share for entry in dependences(with_gravity, found)}
    besides = {name: share for name, share in entries.items() if name != "everywhere"}
    assert max(besides, key=besides.__getitem__) == "position"
    assert all(0.0 <= share <= 1.0 for share in entries.values())
    assert explainable(with_gravity, found) > 0.7


def test_what_is_left_is_told_in_words(with_gravity: Fit) -> None:
    found = missing_force(with_gravity)
    tests = {test.coordinate: test for test in structure(with_gravity, found)}
    assert max(tests.values(), key=lambda test: test.gain).coordinate == "position"
    assert tests["position"].errors > 5.0
    said = remainder_of(with_gravity, found, found.rms**2)
    assert said.share == pytest.approx(1.0)
    assert "a torque that depends on the position" in said.words


def test_what_a_delay_leaves_of_a_lag_follows_the_current(hidden: Callable[..., Any]) -> None:
    """Little as it is: a law that is only like the true one leaves next to nothing, but that has a structure."""
    recording, model = hidden([{"name": "amplifier_lag", "f_a": 60.0, "delta": 0.7}], 8, 8.0)
    nominal = nominal_fit(problem_of([recording], model))
    delayed = nominal.extended(term("transport_delay", {"t_d": 2e-3}, (), 0.1)).maximise()
    delayed.held_out()
    said = remainder_of(delayed, missing_force(delayed), missing_power(nominal))
    assert said.share < constants.STRUCTURE_SHARE
    assert "change of the current" in [entry["coordinate"] for entry in said.structure]


def _function_in_place_of(fit: Fit, law: Term) -> str | None:
    """The coordinate whose function takes the place of a law, fitted beside what is known."""
    with_it = scored(fit.extended(law).maximise())
    other = with_function(scored(fit), 1.0)
    return other.function if other and is_better(other, with_it, 4.0).is_better else None


def test_a_function_of_the_position_beats_a_law_of_something_else_but_not_gravity(with_gravity: Fit) -> None:
    drift = term("thermal_drift", {"r": 0.1, "t_w": 5.0}, (), 0.1)
    assert _function_in_place_of(with_gravity, drift) == "position"
    gravity = term("gravity", {"m_g_l": GRAVITY["m_g_l"], "theta_0": GRAVITY["theta_0"]}, (), 0.1)
    assert _function_in_place_of(with_gravity, gravity) is None


def test_a_ripple_of_many_orders_is_any_function_of_the_position(with_gravity: Fit) -> None:
    """Five orders beside each other, over 0.8 turns of travel, and no ripple is there."""
    orders = [2.0, 3.0, 4.0, 5.0, 6.0]
    values = {"orders": orders, "amplitudes": [1e-4] * 5, "phases": [0.0] * 5}
    assert _function_in_place_of(with_gravity, term("torque_ripple", values, ("orders",), 0.1)) == "position"


def test_a_wrong_inertia_is_judged_by_what_it_gains(hidden: Callable[..., Any]) -> None:
    """With the noise of the model as given its predictions are no slope: a function of the acceleration looked better."""
    recording, model = hidden([{"name": "inertia_error", "r": -0.35}], 8, 8.0, Coloured(0.25, 0.01))
    fit = nominal_fit(problem_of([recording], model))
    law = base_law(fit.problem, "inertia_error")
    assert _function_in_place_of(fit, law.moved([law.start[0] - 0.35])) is None


def test_noise_can_hardly_be_explained(noise_alone: Fit) -> None:
    found = missing_force(noise_alone)
    assert explainable(noise_alone, found) < 0.3
    assert remainder_of(noise_alone, found, found.rms**2).structure == ()


@pytest.mark.parametrize("which", ["with_gravity", "noise_alone"])
def test_the_noise_floor_is_above_zero_and_below_what_is_missing(request: pytest.FixtureRequest, which: str) -> None:
    fit: Fit = request.getfixturevalue(which)
    floor = noise_floor(fit)
    assert 0.0 < floor < 3.0 * missing_force(fit).rms


def test_held_out_it_is_the_same_where_nothing_was_fitted(with_gravity: Fit) -> None:
    assert held_out_rms(with_gravity) == pytest.approx(missing_force(with_gravity).rms, rel=1e-6)


def test_hats_add_up_to_one_and_need_variety() -> None:
    rng = np.random.default_rng(1)
    z = rng.normal(size=500)
    every = np.ones(500, dtype=bool)
    shape = hats(z, every)
    assert shape is not None
    assert shape.sum(axis=1) == pytest.approx(np.ones(500))
    assert shape.min() >= 0.0
    assert hats(np.ones(500), every) is None


def test_the_way_since_a_reversal() -> None:
    velocity = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
    position = np.array([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0])
    way = since_reversal(velocity, position, np.ones(7, dtype=bool))
    assert way.tolist() == [0.0, 1.0, 2.0, 0.0, 1.0, 2.0, 0.0]


def test_a_line_in_time_is_found(hidden: Callable[..., Any], truth: Callable[..., Any]) -> None:
    """A torque at one frequency, as a current that the record does not have."""
    recording, model = hidden([], 9, 20.0)
    fit = nominal_fit(problem_of([recording], model))
    assert lines(fit) == []
    deviation = np.sqrt(fit.out["variance"] * fit.out["share"])
    fit.out["moved"] += 0.7 * deviation * np.sin(2.0 * np.pi * 73.0 * recording.time_s)
    assert lines(fit)[0] == pytest.approx(73.0, abs=0.5)


def test_a_number_of_which_one_block_knows_all_does_not_spoil_that_block() -> None:
    """On the edge of a breakaway a model's own slopes are huge; the other blocks say next to nothing of that number."""
    rng = np.random.default_rng(5)
    block = np.repeat(np.arange(20), 50)
    own = 1e-2 * rng.normal(size=(block.size, 1))
    own[block == 0] = 100.0
    answer = rng.normal(size=(block.size, 1))
    score = 0.3 * answer[:, 0] + rng.normal(size=block.size)
    out = {"score": score, "information": np.ones(block.size)}
    series = SimpleNamespace(fold=np.arange(20) % constants.FOLDS, block=block)
    fit = cast("Fit", SimpleNamespace(out=out, problem=SimpleNamespace(series=series)))
    whole = np.concatenate([answer, own], axis=1)
    shift = np.sum(whole * missing.held_out_coefficients(fit, whole)[series.fold[block]], axis=1)
    gain = np.bincount(block, shift * score - 0.5 * shift**2)
    assert gain.sum() > 30.0
    assert gain[0] > -5.0
