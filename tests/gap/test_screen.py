"""The ranking on runs with one hidden effect, by an independent simulation; and its statistics on plain numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.gap.data import Recording
from hapticd.gap.regression import Blocks, block_gain, cross_validated, estimate, lag_one, solve
from hapticd.gap.screen import screen

from .synthetic import COULOMB, VISCOUS, Torque, model, run


def _stribeck(angle: float, velocity: float, time: float) -> float:
    return -0.5 * COULOMB * math.tanh(velocity / 0.02) * math.exp(-((velocity / 3.0) ** 2))


def _ripple(angle: float, velocity: float, time: float) -> float:
    return 6e-4 * math.sin(7 * angle + 0.5) + 3e-4 * math.sin(12 * angle)


CASES: dict[str, tuple[Torque, str, float]] = {
    "constant_bias": (lambda a, v, t: 4e-4, "tau_0", 4e-4),
    "asymmetric_viscous": (lambda a, v, t: -0.4 * VISCOUS * abs(v), "a_b", 0.4 * VISCOUS),
    "quadratic_drag": (lambda a, v, t: -2e-6 * v * abs(v), "d", 2e-6),
    "return_spring": (lambda a, v, t: -4e-4 * a, "k_s", 4e-4),
    "viscous_friction": (lambda a, v, t: -0.6 * VISCOUS * v, "r_b", 0.6 * VISCOUS),
    "stribeck": (_stribeck, "omega_s", 3.0),
    "torque_ripple": (_ripple, "a_12_sin", 3e-4),
    "gravity": (lambda a, v, t: -8e-4 * math.sin(a - 0.7), "mgl_cos", 8e-4 * math.cos(0.7)),
    "thermal_drift": (lambda a, v, t: -0.5 * COULOMB * (1 - math.exp(-t / 4)) * math.tanh(v / 0.02), "t_w", 4.0),
    "hand_impedance": (lambda a, v, t: (-4e-4 * a - 1e-4 * v) if 5 < t < 13 else 0.0, "k_h", 4e-4),
}


@pytest.mark.parametrize("slug", CASES)
def test_the_hidden_effect_ranks_first(slug: str) -> None:
    torque, coefficient, value = CASES[slug]
    screening = screen([run(torque)], model())
    first = screening.ranking[0]
    assert first.slug == slug
    assert first.significant
    tolerance = 0.25 if coefficient in ("omega_s", "t_w") else 0.05  # values from a grid
    assert first.coefficients[coefficient].value == pytest.approx(value, rel=tolerance)


def test_ripple_orders_are_the_hidden_ones_and_no_more() -> None:
    (score,) = screen([run(_ripple)], model(), ["torque_ripple"]).ranking
    assert set(score.coefficients) == {"a_7_sin", "a_7_cos", "a_12_sin", "a_12_cos"}
    assert score.coefficients["a_7_cos"].value == pytest.approx(6e-4 * math.sin(0.5), rel=0.1)


def test_nothing_explains_a_nominal_run(nominal_run: Recording) -> None:
    screening = screen([nominal_run], model())
    assert max(score.share for score in screening.ranking if score.slug != "stribeck") < 0.05
    assert screening.rms < 0.1 * COULOMB


def test_two_recordings_count_as_one_body_of_evidence() -> None:
    torque = CASES["constant_bias"][0]
    one = screen([run(torque, 8.0, seed=3)], model(), ["constant_bias"]).ranking[0]
    both = screen([run(torque, 8.0, seed=3), run(torque, 8.0, seed=4)], model(), ["constant_bias"]).ranking[0]
    assert both.coefficients["tau_0"].standard_error < one.coefficients["tau_0"].standard_error
    assert both.residual.size > 1.8 * one.residual.size


def test_a_one_sided_run_leaves_a_confounded_pair() -> None:
    turning = run(lambda a, v, t: 4e-4 + 0.03 * 0.4, 10.0, seed=2, centring=0.0)
    screening = screen([turning], model(), ["constant_bias", "coulomb_friction"])
    pairs = {frozenset((pair.first, pair.second)): pair for pair in screening.confounded}
    assert pairs[frozenset(("constant_bias", "coulomb_friction"))].overlap > 0.9


def test_gravity_and_a_ripple_of_order_one_are_the_same() -> None:
    screening = screen([run(CASES["gravity"][0])], model(), ["gravity", "torque_ripple"])
    (pair,) = screening.confounded
    assert {pair.first, pair.second} == {"gravity", "torque_ripple"}
    assert pair.overlap > 0.99
    assert not pair.resolved


def test_a_delay_is_seen_and_cannot_be_told_from_a_lag() -> None:
    recording = run(seconds=10.0)
    late = Recording(**{**recording.__dict__, "current": np.concatenate([recording.current[3:], np.zeros(3)])})
    first, second = screen([late], model(), ["transport_delay", "amplifier_lag", "constant_bias"]).ranking[:2]
    assert {first.slug, second.slug} == {"transport_delay", "amplifier_lag"}
    assert first.identical_to == (second.slug,)
    assert next(iter(first.coefficients.values())).value == pytest.approx(3e-3, rel=0.1)


def test_a_torque_constant_error_is_measured_through_the_passive_torques() -> None:
    recording = run(seconds=10.0)
    weaker = Recording(**{**recording.__dict__, "current": recording.current / 0.8})
    (score,) = screen([weaker], model(), ["torque_constant_error"]).ranking
    assert score.coefficients["rho"].value == pytest.approx(-0.2 / 0.8, rel=0.05)  # r = -0.2


def test_a_negative_delay_is_no_effect() -> None:
    recording = run(seconds=10.0)
    early = Recording(**{**recording.__dict__, "current": np.concatenate([np.zeros(3), recording.current[:-3]])})
    (score,) = screen([early], model(), ["transport_delay"]).ranking
    assert not score.possible
    assert not score.significant


def test_given_effects_leave_nothing_for_their_rivals() -> None:
    hidden = run(CASES["asymmetric_viscous"][0])
    left = screen([hidden], model(), ["constant_bias"], given=("asymmetric_viscous",)).ranking[0]
    assert abs(left.coefficients["tau_0"].value) < 2e-5
    assert left.share < 0.05


def test_effects_of_angles_are_not_asked_of_linear_devices(nominal_run: Recording) -> None:
    slugs = {score.slug for score in screen([nominal_run], model()).ranking}
    assert {"gravity", "torque_ripple", "encoder_eccentricity"} <= slugs
    linear = Recording(**{**nominal_run.__dict__, "is_linear": True})
    assert not {"gravity", "torque_ripple"} & {score.slug for score in screen([linear], model()).ranking}


def test_standard_errors_know_autocorrelation() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(4000) * 0.01
    found, claimed = [], []
    for _ in range(100):
        noise = np.convolve(rng.normal(size=4100), np.ones(30) / 30, mode="valid")[:4000]
        fit = estimate(np.ones((4000, 1)), noise, Blocks.of(time))
        found.append(fit.coefficients[0])
        claimed.append(fit.standard_errors[0])
    assert np.mean(claimed) == pytest.approx(np.std(found), rel=0.25)
    assert lag_one(noise) > 0.9


def test_identical_columns_share_their_estimate() -> None:
    column = np.linspace(-1.0, 1.0, 100)
    coefficients = solve(np.stack([column, column, 0 * column], axis=1), 3.0 * column)
    assert coefficients[:2].sum() == pytest.approx(3.0, rel=1e-6)
    assert coefficients[2] == 0.0


def test_held_out_blocks_do_not_see_themselves() -> None:
    time = np.arange(2000) * 0.01
    blocks = Blocks.of(time)
    own = (blocks.number == 3).astype(np.float64)
    residual = cross_validated(own[:, None], own, blocks)
    assert np.array_equal(residual, own)  # nothing outside block 3 could tell its level
    gain, sure = block_gain(own, 0.5 * own, blocks)
    assert gain == pytest.approx(0.75)
    assert sure < 1.1  # one block in twenty


def test_gain_in_calm_blocks_counts_like_gain_in_lively_ones() -> None:
    rng = np.random.default_rng(6)
    blocks = Blocks.of(np.arange(4000) * 0.01)
    noise = rng.normal(size=4000) * np.where(blocks.number == 7, 100.0, 1.0)
    everywhere = block_gain(noise, 0.8 * noise, blocks)
    assert everywhere[0] == pytest.approx(0.36)
    assert everywhere[1] > 100.0
    lively = block_gain(noise, np.where(blocks.number == 7, 0.8, 1.02) * noise, blocks)
    assert lively[0] > 0.3
    assert lively[1] < 1.0
