"""At the edge of what can be asked: overdamped, coasting, at rest, in pieces, given back, interrupted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hapticd.gap import answer, find_gap, remainder
from hapticd.gap.base_model import most_friction, problem_of
from hapticd.gap.fit import Fit
from hapticd.gap.law_set import is_at_noise_level
from hapticd.gap.lines import lines
from hapticd.gap.missing import missing_force, since_reversal
from hapticd.gap.model_file import improved_model, with_effects
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.prediction import predicted, prediction_errors
from hapticd.gap.recording import Recording
from hapticd.gap.terms import term
from hapticd.gap.workflow import considered

from .synthetic import COUNTS, INERTIA, TORQUE_CONSTANT, drive, model

RESOLUTION = 2.0 * math.pi / COUNTS
Hidden = Callable[..., Any]


def recorded(
    current: Any, viscous: float, coulomb: float, bias: float = 0.0, speed: float = 0.0, every: int = 1
) -> Recording:
    """A shaft by explicit steps of 50 µs under a current for each millisecond; `every` so many of those are recorded."""
    angle, velocity, counts = 0.0, speed, []
    for amperes in current:
        counts.append(math.floor(angle / RESOLUTION))
        for _ in range(20):
            friction = viscous * velocity + coulomb * math.tanh(velocity / 0.02)
            velocity += 5e-5 * (TORQUE_CONSTANT * amperes + bias - friction) / INERTIA
            angle += 5e-5 * velocity
    position = (np.array(counts[::every]) + 0.5) * RESOLUTION
    time_s, period_s = np.arange(position.size) * 1e-3 * every, 1e-3 * every
    held = np.asarray(current, dtype=np.float64)[::every]
    return Recording("edge", time_s, position, RESOLUTION, held, None, period_s, False)


def test_a_bias_is_found_where_viscosity_stops_the_shaft_within_a_period() -> None:
    """J/b = 17 ms at 50 Hz: what is left of a velocity after a period is less than a third, and yet the shaft moves.

    Its Coulomb friction is smooth, c tanh(v/v_s): friction that rises from rest.
    """
    current = np.repeat(drive(20.0, 1)[::20], 20)
    recording = recorded(current, viscous=1.2e-3, coulomb=1.5e-3, bias=1.5e-3, every=20)
    found = find_gap([recording], model(viscous=1.2e-3), design=False)
    assert found.effects[0] == "constant_bias", found.statement
    assert set(found.effects) <= {"constant_bias", "stribeck"}, found.statement
    assert all(step.parameters["s"].value < -0.3 for step in found.steps[1:])
    assert found.steps[0].parameters["tau_0"].value == pytest.approx(1.5e-3, rel=0.1)


def test_a_coasting_shaft_tells_its_viscous_friction_over_its_inertia() -> None:
    """Without a current no law cancels the drive, and no torque but the friction's says what torques are of the order of."""
    recording = recorded(np.zeros(2000), viscous=6e-5, coulomb=0.0, speed=40.0)
    found = find_gap([recording], model(viscous=4e-5, coulomb=0.0), design=False)
    assert found.effects == ("viscous_friction",), found.statement
    assert found.steps[0].parameters["r"].value == pytest.approx(0.5, abs=0.01)
    assert set(found.steps[0].indistinguishable_from) == {"asymmetric_viscous", "inertia_error"}


@pytest.mark.parametrize(("late", "speed"), [(0, 0.0), (8, 0.0), (0, 40.0)], ids=["plain", "late", "coasting"])
def test_the_largest_friction_that_is_fitted_is_no_less_than_the_true_one(late: int, speed: float) -> None:
    """Fast motion under a current that acts 8 ms later, as nobody knows yet; and a shaft that nothing but friction stops."""
    swing = np.arange(2000) * 1e-3
    current = np.zeros(2000) if speed else 0.35 * np.sin(2.0 * np.pi * (2.0 * swing + 8.0 * swing**2))
    recording = recorded(current, viscous=4e-5, coulomb=1.5e-3, speed=speed)
    known = recording.current if speed else np.concatenate([current[late:], np.zeros(late)])
    problem = problem_of([replace(recording, current=known)], model(coulomb=1e-4))
    assert 1.5e-3 < most_friction(problem)[0] < 5e-2
    both = problem_of([replace(recording, current=known)] * 2, model(coulomb=1e-4))
    assert most_friction(both)[0] == pytest.approx(most_friction(problem)[0])


def test_the_largest_friction_has_stretches_of_a_few_samples_too() -> None:
    recording = recorded(drive(2.0, 1), viscous=4e-5, coulomb=1.5e-3)
    kept = ~np.isin(np.arange(recording.rows), [*range(500, 512), *range(517, 530), *range(531, 540)])
    parts = {name: getattr(recording, name)[kept] for name in ("time_s", "position", "current")}
    problem = problem_of([replace(recording, **parts)], model())
    assert problem.series.begins.sum() == 4
    assert most_friction(problem)[0] == pytest.approx(most_friction(problem_of([recording], model()))[0], rel=0.1)


def test_a_shaft_that_rests_most_of_the_time_is_asked_for_a_hand_too() -> None:
    current = np.where(np.arange(8000) < 600, 0.2 * np.sin(np.arange(8000) / 40.0), 0.0)
    recording = recorded(current, viscous=4e-5, coulomb=1.5e-3)
    found = find_gap([recording], model(), candidates=["hand_impedance", "constant_bias"], design=False)
    assert found.verdict == "no_missing_effect", found.statement


def test_predictions_do_not_run_across_gaps_and_know_each_recordings_period() -> None:
    current = drive(8.0, 2)
    whole = recorded(current, viscous=4e-5, coulomb=1.5e-3)
    slow = recorded(np.repeat(current[::4], 4), viscous=4e-5, coulomb=1.5e-3, every=4)
    rows = np.r_[0:3000, 5000:8000]
    parts = replace(
        whole,
        time_s=whole.time_s[rows],
        position=whole.position[rows],
        current=np.ascontiguousarray(whole.current[rows]),
    )
    errors = {}
    for name, recordings in {"whole": [whole], "parts": [parts], "both": [whole, slow]}.items():
        fit = nominal_fit(problem_of(recordings, model()))
        found = predicted(fit)
        errors[name] = prediction_errors(found, found, is_linear=False)["k_step"]["before"]
    assert errors["parts"] < 2.0 * errors["whole"]
    assert errors["both"] < 3.0 * errors["whole"]


def test_nothing_is_predicted_where_no_stretch_is_long_enough() -> None:
    whole = recorded(drive(4.0, 3), viscous=4e-5, coulomb=1.5e-3)
    rows = np.flatnonzero(np.arange(4000) % 50 < 40)
    parts = replace(
        whole,
        time_s=whole.time_s[rows],
        position=whole.position[rows],
        current=np.ascontiguousarray(whole.current[rows]),
    )
    fit = nominal_fit(problem_of([parts], model()))
    assert predicted(fit) is None
    assert prediction_errors(None, None, is_linear=False) == {}


def test_an_interruption_at_the_end_keeps_what_was_found(hidden: Hidden, monkeypatch: pytest.MonkeyPatch) -> None:
    recording, nominal = hidden([{"name": "constant_bias", "tau_0": 6e-4}], 15, 6.0)
    remainder_of, asked = answer.remainder_of, []

    def interrupted_once(*given: Any) -> Any:
        asked.append(given)
        if len(asked) == 1:
            raise KeyboardInterrupt
        return remainder_of(*given)

    monkeypatch.setattr(answer, "remainder_of", interrupted_once)
    found = find_gap([recording], nominal, candidates=["constant_bias"], design=False)
    assert found.interrupted
    assert found.effects == ("constant_bias",)


def test_on_an_axis_an_order_is_a_period(hidden: Hidden, monkeypatch: pytest.MonkeyPatch) -> None:
    recording, nominal = hidden([], 5, 8.0)
    fit = nominal_fit(replace(problem_of([recording], nominal), is_linear=True))
    monkeypatch.setattr(remainder.ripple, "orders_left", lambda fit, scale: [100.0])
    found = remainder.remainder_of(fit, missing_force(fit), 1.0)
    assert found.fingerprint == ("a period of 0.0628 m in position",)


def test_orders_that_have_no_name_are_told(hidden: Hidden) -> None:
    ripple = {"name": "torque_ripple", "orders": [7.0], "amplitudes": [4e-4], "phases": [0.3]}
    recording, nominal = hidden([ripple], 5, 8.0)
    found = find_gap([recording], nominal, candidates=["constant_bias"], design=False)
    assert "order 7 in angle" in found.remainder.fingerprint
    assert "order 7 in angle" in found.remainder.words
    nothing, nominal = hidden([], 5, 8.0)
    assert find_gap([nothing], nominal, candidates=["constant_bias"], design=False).remainder.fingerprint == ()


@pytest.mark.parametrize("refit_base", [False, True])
def test_frictions_that_the_model_has_not_are_found(refit_base: bool) -> None:
    """Corrections are factors, and no factor makes something of nothing."""
    recording, nominal = recorded(drive(8.0, 1), viscous=6e-5, coulomb=1.5e-3), model(viscous=0.0, coulomb=0.0)
    names = ["constant_bias"] if refit_base else ["coulomb_friction", "viscous_friction"]
    found = find_gap([recording], nominal, candidates=names, refit_base=refit_base, design=False)
    assert set(found.effects) == {"coulomb_friction", "viscous_friction"}, found.statement
    plant = improved_model(nominal, found).plant
    assert plant.coulomb == pytest.approx(1.5e-3, rel=0.02)
    assert plant.viscous == pytest.approx(6e-5, rel=0.05)
    assert len(found.warnings) == len(found.effects)


def test_a_device_without_friction_needs_none() -> None:
    recording = recorded(drive(4.0, 1, size=0.05), viscous=0.0, coulomb=0.0)
    found = find_gap([recording], model(viscous=0.0, coulomb=0.0), candidates=["coulomb_friction", "viscous_friction"])
    assert found.effects == ()
    improved = improved_model(model(viscous=0.0, coulomb=0.0), found)
    assert (improved.plant.viscous, improved.plant.coulomb) == (0.0, 0.0)


def test_what_cannot_be_looked_for_is_refused_alone_and_said_beside_others() -> None:
    gravity = with_effects(model(), [("gravity", {"m_g_l": 1e-3, "theta_0": 0.0})])
    recording = recorded(drive(2.0, 1), viscous=4e-5, coulomb=1.5e-3)
    has_it = "gravity cannot be considered: the model has it already"
    with pytest.raises(ValueError, match=has_it):
        find_gap([recording], gravity, candidates=["gravity"])
    found = find_gap([recording], gravity, candidates=["gravity", "return_spring"], design=False)
    assert found.details["candidates"] == ["return_spring"]
    assert has_it in found.warnings


def test_an_effect_that_is_unknown_has_a_nearest_one() -> None:
    with pytest.raises(ValueError, match=r"^unknown effect 'stribek': not in the catalogue; did you mean stribeck\?$"):
        considered(model(), ["gravity", "stribek"])
    with pytest.raises(ValueError, match=r"^unknown effect 'xyz': not in the catalogue \(coulomb_friction, .*\)$"):
        considered(model(), ["xyz"])


@pytest.mark.parametrize("coulomb", [1e-9, 1e-5])
def test_next_to_no_friction_before_a_coupling_has_a_likelihood(coulomb: float) -> None:
    """What stops the shaft lies so close together that the variance in between is less than rounding."""
    problem = problem_of([recorded(drive(2.0, 1), viscous=4e-5, coulomb=1.5e-3)], model(coulomb=coulomb))
    item = term("flexible_coupling", {"f_r": 250.0, "load_share": 0.4, "damping": 0.014}, (), 0.1)
    nominal = nominal_fit(problem)
    assert nominal.extended(item).log_likelihood > 10.0 * nominal.log_likelihood


def test_a_line_is_told_by_the_clock_of_its_own_recording() -> None:
    """40 Hz in two recordings, one of 1 kHz and one of 500 Hz; and none at what the mean of their clocks makes of it."""
    rng = np.random.default_rng(1)
    time_s = [np.arange(8000) / 1000.0, np.arange(8000) / 500.0]
    moved = np.concatenate([np.sin(2.0 * np.pi * 40.0 * t) + rng.normal(size=t.size) for t in time_s])
    recording = np.repeat([0, 1], 8000)
    periods_s = [1e-3, 2e-3]
    series = SimpleNamespace(recording=recording, periods_s=periods_s)
    out = {"variance": np.ones(16000), "share": np.ones(16000), "moved": moved}
    fit = cast("Fit", SimpleNamespace(out=out, problem=SimpleNamespace(series=series)))
    assert lines(fit) == [pytest.approx(40.0, abs=0.3)]


def test_a_way_since_a_reversal_does_not_run_into_the_next_recording() -> None:
    position = np.array([0.0, 1.0, 2.0, 100.0, 101.0])
    begins = np.array([True, False, False, True, False])
    way = since_reversal(np.ones(5), position, np.ones(5, dtype=bool), begins)
    assert way.tolist() == [0.0, 1.0, 2.0, 0.0, 1.0]


@pytest.mark.parametrize("seed", [11, 15])
def test_a_current_that_meets_its_limit_in_one_swing_is_named(hidden: Hidden, seed: int) -> None:
    recording, _ = hidden([], seed, 6.0)
    limit = 0.8 * float(np.abs(recording.current).max())
    recording, nominal = hidden([{"name": "current_saturation", "i_max": limit}], seed, 6.0)
    met = np.flatnonzero(np.abs(recording.current) > limit) * recording.period_s
    assert np.ptp(met) < 0.5
    assert not is_at_noise_level(nominal_fit(problem_of([recording], nominal)))
    result = find_gap([recording], nominal, design=False)
    assert (result.verdict, result.effects) == ("effect_found", ("current_saturation",)), result.statement
    (step,) = result.steps
    assert step.parameters["i_max"].value == pytest.approx(limit, rel=1e-3)


def test_a_model_of_another_device_names_nothing(hidden: Hidden, monkeypatch: pytest.MonkeyPatch) -> None:
    recording, nominal = hidden([{"name": "constant_bias", "tau_0": 4e-4}], 11, 6.0)
    monkeypatch.setattr("hapticd.gap.missing.own_torque", lambda fit: 0.0)
    found = find_gap([recording], nominal, candidates=["constant_bias"], design=False)
    assert (found.verdict, found.effects) == ("unexplained", ())
    assert found.gap.held_out_before == found.gap.held_out_after
