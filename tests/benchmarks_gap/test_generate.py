"""Recordings of the benchmark: reproducible, honest about time, and unchanged by effects at their neutral values."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

from benchmarks.gap import devices, recipes
from benchmarks.gap.generate import STEP_S, UnstableError, visibility
from benchmarks.gap.generate import generate as generate_exactly
from benchmarks.gap.hidden import LAWS
from hapticd.config import parse_config

SHORT_S = 2.0
COARSE_S = 4.0 * STEP_S
generate = partial(generate_exactly, step_s=COARSE_S)

NEUTRAL = {
    "inertia_error": {"r": 0.0},
    "viscous_friction": {"r": 0.0},
    "coulomb_friction": {"r": 0.0},
    "torque_constant_error": {"r": 0.0},
    "asymmetric_coulomb": {"a": 0.0},
    "asymmetric_viscous": {"a": 0.0},
    "stribeck": {"s": 0.0, "omega_s": 3.0},
    "presliding": {"breakaway": 0.0, "sigma_1": 1e-3},
    "quadratic_drag": {"d": 0.0},
    "load_dependent_friction": {"kappa": 0.0},
    "constant_bias": {"tau_0": 0.0},
    "gravity": {"m_g_l": 0.0, "theta_0": 1.0},
    "torque_ripple": {"orders": [7], "amplitudes": [0.0], "phases": [1.0]},
    "return_spring": {"k_s": 0.0, "theta_0": 1.0},
    "transport_delay": {"t_d": 0.0},
    "amplifier_lag": {"f_a": math.inf, "delta": 0.5},
    "current_saturation": {"i_max": math.inf},
    "dac_quantization": {"q": 0.0},
    "backlash": {"gap": 0.0, "load_share": 0.4},
    "flexible_coupling": {"f_r": math.inf, "load_share": 0.4, "damping": 0.1},
    "encoder_eccentricity": {"e": 0.0, "phi": 1.0},
    "dropped_samples": {"p": 0.0},
    "thermal_drift": {"r": 0.0, "t_w": 5.0},
    "hand_impedance": {"m_h": 0.0, "b_h": 0.0, "k_h": 0.0, "on_s": 0.5, "off_s": 1.0, "rest": 0.0},
}


@pytest.mark.parametrize("slug", LAWS)
def test_neutral_values_change_nothing(slug: str) -> None:
    plain = generate([], 3, SHORT_S)
    neutral = generate([{"name": slug, **NEUTRAL[slug]}], 3, SHORT_S)
    np.testing.assert_array_equal(neutral.counts, plain.counts)
    np.testing.assert_array_equal(neutral.states[:, :2], plain.states[:, :2])


@pytest.mark.parametrize("slug", LAWS)
def test_every_effect_is_seen_and_its_own_model_sees_nothing_else(slug: str) -> None:
    duration = 4.0
    scale = recipes.scale_of("re35", 3, duration)
    effect = recipes.draw(slug, scale, np.random.default_rng(1))(0.5)
    recording = generate([effect], 3, duration)
    assert visibility(recording) > 0.01
    if slug not in ("backlash", "flexible_coupling", "presliding", "amplifier_lag", "dropped_samples"):
        # The others have a state that starts unknown. A grip begins between two steps, so these are those of the recording.
        assert visibility(recording, [effect], COARSE_S) < 5e-3


def test_the_seed_makes_the_recording() -> None:
    first, again, other = generate([], 5, SHORT_S), generate([], 5, SHORT_S), generate([], 6, SHORT_S)
    np.testing.assert_array_equal(first.counts, again.counts)
    np.testing.assert_array_equal(first.current_command, again.current_command)
    np.testing.assert_array_equal(first.time_s, again.time_s)
    assert not np.array_equal(first.counts, other.counts)


@pytest.mark.parametrize("device", devices.MODELS)
def test_a_session_moves_the_device_both_ways_and_stays_within_its_limits(device: str) -> None:
    found = generate([], 2, 10.0, device)
    rate = found.nominal["servo"]["rate_hz"]
    omega = found.states[:, 1]
    assert found.time_s.size == round(10 * rate)
    assert np.all(np.diff(found.time_s) > 0.0)
    assert 0.0 < np.median(found.lateness_s) < 2e-5 < found.lateness_s.max() < 1.0 / rate
    assert (omega > 0.02 * omega.max()).mean() > 0.1
    assert (omega < 0.02 * omega.min()).mean() > 0.1
    assert (omega == 0.0).any()
    assert np.ptp(found.counts) > 1000
    assert np.abs(omega).max() < devices.LAB_SPEED[device]
    assert visibility(found) < 1e-3


def test_the_counts_are_the_floored_position_with_its_noise() -> None:
    quiet = generate([], 4, SHORT_S, noise_counts=0.0)
    floored = np.floor(quiet.states[:, 0] / quiet.device.resolution)
    np.testing.assert_array_equal(quiet.counts, floored)
    noisy = generate([], 4, SHORT_S, noise_counts=0.3)
    error = noisy.counts + 0.5 - noisy.states[:, 0] / noisy.device.resolution
    assert np.std(error) == pytest.approx(math.sqrt(1 / 12 + 0.09), rel=0.15)


def test_lost_commands_are_recorded_but_do_not_arrive() -> None:
    lossy = generate([{"name": "dropped_samples", "p": 0.3}], 4, SHORT_S)
    assert visibility(lossy) > 0.1


def test_a_device_that_no_spring_holds_is_refused() -> None:
    with pytest.raises(UnstableError, match="return_spring"):
        generate([{"name": "return_spring", "k_s": -1.0, "theta_0": 0.1}], 1, SHORT_S)


@pytest.mark.parametrize("slug", ["coulomb_friction", "stribeck", "transport_delay", "amplifier_lag", "backlash"])
def test_a_stronger_effect_is_seen_better(slug: str) -> None:
    duration = 4.0
    scale = recipes.scale_of("re35", 7, duration)
    recipe = recipes.draw(slug, scale, np.random.default_rng(2))
    weak, strong = (visibility(generate([recipe(strength)], 7, duration)) for strength in (0.1, 1.0))
    assert strong > 3.0 * weak


def test_sizes_at_full_strength_are_those_of_the_device() -> None:
    scale = recipes.scale_of("re35", 3, SHORT_S)
    full = {slug: recipes.draw(slug, scale, np.random.default_rng(4))(1.0) for slug in LAWS}
    assert abs(full["coulomb_friction"]["r"]) == 0.5
    assert abs(full["constant_bias"]["tau_0"]) == pytest.approx(6e-4)
    assert full["gravity"]["m_g_l"] == pytest.approx(1.2e-3)
    assert full["transport_delay"]["t_d"] == pytest.approx(1.5e-3)
    assert full["amplifier_lag"]["f_a"] == pytest.approx(60.0)
    assert full["flexible_coupling"]["f_r"] == pytest.approx(25.0)
    assert full["backlash"]["gap"] == pytest.approx(0.02, rel=0.01)
    assert full["presliding"]["breakaway"] == pytest.approx(0.02, rel=0.01)
    assert full["dac_quantization"]["q"] == pytest.approx(1.5 * 2e-3 / 0.0292)
    assert full["current_saturation"]["i_max"] == pytest.approx(scale.limits[0])
    assert full["return_spring"]["k_s"] * scale.travel == pytest.approx(1.2e-3)
    for slug in LAWS:
        parse_config({"plant": {"effects": [plain(full[slug])]}}, slug)


def plain(effect: dict[str, object]) -> dict[str, object]:
    return {key: float(value) if isinstance(value, np.floating) else value for key, value in effect.items()}


@pytest.mark.parametrize("slug", ["inertia_error", "viscous_friction", "coulomb_friction", "torque_constant_error"])
def test_a_wrong_base_parameter_is_wrong_by_a_tenth_to_four_tenths(slug: str) -> None:
    drawn = [recipes.wrong_base(slug, np.random.default_rng(seed))["r"] for seed in range(50)]
    assert {math.copysign(1.0, r) for r in drawn} == {-1.0, 1.0}
    assert all(0.1 <= abs(r) <= 0.4 for r in drawn)
