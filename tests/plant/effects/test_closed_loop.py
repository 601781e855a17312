"""Effects where commands come one by one: the plant block, the loopback in virtual time, the servo loop."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hapticd.config import Config, parse_config
from hapticd.effects.catalogue import CATALOGUE
from hapticd.plant import kernel
from hapticd.plant.closed_loop import stays_with_effects
from hapticd.plant.layout import LOAD_OMEGA, LOAD_THETA, initial_state
from hapticd.servo.simulate import simulate
from tests.plant.effects.independent import KT, PERIOD, B, C, J, excitation, simulated, vector

EXAMPLES: dict[str, dict[str, Any]] = {
    "inertia_error": {"r": 0.5},
    "viscous_friction": {"r": 5.0},
    "coulomb_friction": {"r": -0.5},
    "asymmetric_coulomb": {"a": 0.3},
    "asymmetric_viscous": {"a": 0.5},
    "stribeck": {"s": 0.5, "omega_s": 3.0},
    "presliding": {"breakaway": 2e-3, "sigma_1": 1e-4},
    "quadratic_drag": {"d": 2e-6},
    "load_dependent_friction": {"kappa": 0.2},
    "constant_bias": {"tau_0": 5e-4},
    "gravity": {"m_g_l": 2e-3, "theta_0": 0.5},
    "torque_ripple": {"orders": [7], "amplitudes": [5e-4]},
    "return_spring": {"k_s": 0.01, "theta_0": 0.1},
    "torque_constant_error": {"r": 0.2},
    "transport_delay": {"t_d": 4e-4},
    "amplifier_lag": {"f_a": 200.0},
    "current_saturation": {"i_max": 0.15},
    "dac_quantization": {"q": 0.05},
    "backlash": {"gap": 0.02},
    "flexible_coupling": {"f_r": 60.0},
    "encoder_eccentricity": {"e": 0.02, "phi": 0.3},
    "dropped_samples": {"p": 0.1},
    "thermal_drift": {"r": 0.5, "t_w": 0.1},
    "hand_impedance": {"m_h": 3e-6, "b_h": 1e-5, "k_h": 0.01, "on_s": 0.03, "off_s": 0.1},
}
IDEAL = {"bandwidth_hz": 0, "dac_bits": 0, "peak_current": 0, "continuous_current": 0}


def config_with(*effects: dict[str, Any], **sections: Any) -> Config:
    return parse_config({"amplifier": IDEAL, "plant": {"effects": list(effects)}, **sections}, "test")


def driven(config: Config, currents: Any) -> Any:
    """Positions of a plant block after every period, under one command a period."""
    f = kernel.init_plant(config)
    i = f.view(np.int64)
    positions = []
    for k, current in enumerate(currents):
        kernel.plant_command(f, i, k * 1_000_000, 0.0, current)
        kernel.plant_advance(f, i, (k + 1) * 1_000_000, 0.0)
        positions.append(f[kernel.POSITION])
    return np.array(positions)


def test_there_is_an_example_of_every_effect() -> None:
    assert EXAMPLES.keys() == CATALOGUE.keys()


@pytest.mark.parametrize(
    "slug", [s for s in EXAMPLES if s not in ("dropped_samples", "transport_delay", "encoder_eccentricity")]
)
def test_the_plant_moves_as_the_kernels_of_a_record(slug: str) -> None:
    currents = excitation(150)
    p = vector(**{f"{slug}__{name}": value for name, value in EXAMPLES[slug].items()})
    expected, _ = simulated(p, currents)
    got = driven(config_with({"name": slug, **EXAMPLES[slug]}), currents)
    # A record's current is taken to have been there before; the plant begins without.
    if slug == "amplifier_lag":
        assert np.abs(got - expected)[20:].max() < 0.02 * np.ptp(expected)
    else:
        assert np.abs(got - expected).max() < 1e-10


def test_a_springy_play_moves_as_the_kernels_of_a_record_and_is_not_the_rigid_one() -> None:
    springy = {"gap": 0.02, "stiffness": 2.0, "damping": 2e-4}
    currents = excitation(150)
    expected, _ = simulated(vector(**{f"backlash__{name}": value for name, value in springy.items()}), currents)
    got = driven(config_with({"name": "backlash", **springy}), currents)
    rigid = driven(config_with({"name": "backlash", "gap": 0.02}), currents)
    assert np.abs(got - expected).max() < 1e-10
    assert np.abs(got - rigid).max() > 0.02 * np.ptp(rigid)


@pytest.mark.parametrize(
    ("position", "speed", "stays"),
    [(0.0, 0.0, True), (0.0, 0.3, True), (0.0, 3.0, False), (0.0105, 0.0, True), (0.0115, 0.0, False)],
)
def test_a_shaft_stays_where_no_contact_can_push_it_loose(position: float, speed: float, stays: bool) -> None:
    p = vector(backlash__gap=0.02, backlash__stiffness=2.0, backlash__damping=1e-5)
    state = initial_state()
    state[LOAD_THETA], state[LOAD_OMEGA] = position, speed
    assert stays_with_effects(p, state, 0.0, 0.0) is stays
    positions, _ = simulated(p, np.zeros(100), state)
    assert bool(np.all(positions == 0.0)) is stays


def test_a_delay_beyond_the_amplifier_s_is_exact() -> None:
    currents = excitation(100)
    got = driven(config_with({"name": "transport_delay", "t_d": 4e-4}), currents)
    fine = np.repeat(np.append(0.0, currents), 5)[3:-2]
    expected, _ = simulated(vector(), fine, period=PERIOD / 5)
    assert np.abs(got - expected[4::5]).max() < 1e-11


def test_eccentricity_is_what_the_encoder_sees_and_not_what_is() -> None:
    config = config_with({"name": "encoder_eccentricity", "e": 0.02, "phi": 0.3})
    f = kernel.init_plant(config, 1.234)
    expected = 1.234 + 0.02 * math.sin(1.234 + 0.3)
    assert kernel.plant_counts(f, f.view(np.int64)) == math.floor(expected / config.raw_resolution)
    currents = excitation(50)
    assert np.array_equal(driven(config, currents), driven(config_with(), currents))


def test_lost_commands_are_seeded_and_as_many_as_said() -> None:
    def kept(seed: int, count: int = 20_000) -> Any:
        f = kernel.init_plant(config_with({"name": "dropped_samples", "p": 0.2}, dither={"seed": seed}))
        i = f.view(np.int64)
        seen = []
        for k in range(count):
            kernel.plant_command(f, i, k * 1000, 0.0, float(k))
            seen.append(f[kernel.CURRENT] == k)
        return np.array(seen)

    lost = ~kept(1)
    assert np.array_equal(lost, ~kept(1))
    assert not np.array_equal(lost, ~kept(2))
    assert lost.mean() == pytest.approx(0.2, abs=4 * math.sqrt(0.2 * 0.8 / 20_000))
    both = (lost[1:] & lost[:-1]).mean()
    assert both == pytest.approx(0.04, abs=0.008)


def test_an_amplifier_that_is_switched_off_is_off_whatever_the_link_loses() -> None:
    f = kernel.init_plant(config_with({"name": "dropped_samples", "p": 0.99}))
    i = f.view(np.int64)
    f[kernel.AIM] = f[kernel.CURRENT] = 1.0
    kernel.plant_current(f, i, 0, 0.0, 0.0)
    assert f[kernel.CURRENT] == 0.0


@pytest.mark.parametrize("slug", EXAMPLES)
def test_simulate_runs_and_is_repeatable(slug: str) -> None:
    config = config_with({"name": slug, **EXAMPLES[slug]}, encoder={"decimation": 217})
    first = simulate(config, 0.2, deflection=20.3)
    again = simulate(config, 0.2, deflection=20.3)
    assert first["final"] == again["final"]
    assert first["outcome"] in ("monotone", "decaying", "persistent", "growing")
    base = simulate(config_with(encoder={"decimation": 217}), 0.2, deflection=20.3)
    assert first["final"] != base["final"] or slug == "current_saturation"
    assert first.keys() == base.keys()


def test_a_seed_changes_the_lost_commands_of_a_simulation() -> None:
    config = config_with({"name": "dropped_samples", "p": 0.3}, encoder={"decimation": 217})
    finals = {simulate(config, 0.1, deflection=20.3, seed=seed)["final"]["position_ticks"] for seed in (1, 1, 2)}
    assert len(finals) == 2


@pytest.mark.parametrize(
    ("effects", "speed", "current", "stays"),
    [
        ([], 0.0, 0.5 * C / KT, True),
        ([{"name": "constant_bias", "tau_0": 0.6 * C}], 0.0, 0.5 * C / KT, False),
        ([{"name": "stribeck", "s": 1.0, "omega_s": 3.0}], 0.0, 1.5 * C / KT, True),
        ([{"name": "stribeck", "s": 1.0, "omega_s": 3.0}], 0.1, 0.0, False),
        ([{"name": "gravity", "m_g_l": 2 * C, "theta_0": 1.0}], 0.0, 0.0, False),
        ([{"name": "presliding", "breakaway": 1e-3}], 1e-4, 0.0, True),
        ([{"name": "presliding", "breakaway": 1e-3}], 2.0, 0.0, False),
        ([{"name": "flexible_coupling", "f_r": 50.0}], 0.0, 0.0, True),
        ([{"name": "hand_impedance", "k_h": 1.0, "off_s": 1.0}], 0.0, 0.0, False),
    ],
)
def test_what_stays_at_rest(effects: list[dict[str, Any]], speed: float, current: float, stays: bool) -> None:
    f = kernel.init_plant(config_with(*effects), 0.0, speed)
    i = f.view(np.int64)
    kernel.plant_command(f, i, 0, 0.0, current)
    assert kernel.plant_stays(f, i) is stays


def test_effects_that_edit_the_model_keep_the_exact_path() -> None:
    exact = [
        s
        for s in EXAMPLES
        if CATALOGUE[s].accuracy == 0.0 and s not in ("amplifier_lag", "hand_impedance", "load_dependent_friction")
    ]
    for slug in exact:
        f = kernel.init_plant(config_with({"name": slug, **EXAMPLES[slug]}))
        assert f.view(np.int64)[kernel.HAS_EFFECT_TERMS] == 0, slug
    f = kernel.init_plant(config_with(*({"name": s, **EXAMPLES[s]} for s in exact)))
    assert f[kernel.INERTIA] == J * 1.5
    assert f[kernel.VISCOUS] == B * 6.0
    assert f[kernel.TORQUE_CONSTANT] == pytest.approx(KT * 1.2)
    assert f[kernel.BIAS] == pytest.approx(5e-4 - 0.3 * 0.5 * C)
