"""The defaults, the presets, and the numbers that follow from them."""

from math import pi

import pytest

from hapticd.config import Config, load_config, parse_yaml, preset_names
from hapticd.config.assumed import assumed
from hapticd.config.presets import PRESETS

# Table II of the paper as printed, with T = 1/3 ms where it rounds to 0.33 ms: m, b, c, Δ in µm, T, K
TABLE_II = {
    "delta": (0.250, 0.01, 0.883, 30, 1e-3 / 3, 14500),
    "freedom6": (0.250, 0.01, 0.06, 20, 1e-3, 2400),
    "impulse_engine": (0.032, 0.02, 0.024, 31.4, 0.2e-3, 800),
    "mit_toolhandle": (0.119, 0.001, 0.034, 20.1, 1e-3, 3125),
    "omega": (0.220, 0.01, 0.147, 10, 1e-3 / 3, 14500),
    "phantom": (0.072, 0.005, 0.038, 29.1, 1e-3, 1015),
}
# μ, β, σ recomputed from the physical columns; the printed ones differ where the table rounds (and for Freedom 6's β)
NUMBERS = {
    "delta": (155.2, 0.0021, 2.03),
    "freedom6": (104.2, 0.0042, 1.25),
    "impulse_engine": (1000, 0.125, 0.955),
    "mit_toolhandle": (38.08, 0.00032, 0.541),
    "omega": (136.6, 0.0021, 1.01),
    "phantom": (70.9, 0.0049, 1.29),
}


RIGS = ("epos4", "hapkit", "mj5208", "srv02")
"""Rigs that people have."""


def test_preset_names() -> None:
    assert preset_names() == ("re35", *sorted((*TABLE_II, *RIGS)))


@pytest.mark.parametrize("name", RIGS)
def test_rigs_say_all_of_themselves_and_how_a_driver_reaches_them(name: str) -> None:
    config = load_config(name)
    assert assumed(config) == ()
    sigma = config.plant.uncertainty
    assert 0.0 < sigma.inertia < config.plant.inertia
    assert 0.0 < sigma.coulomb < config.plant.coulomb
    text = " ".join(line.lstrip("# ") for line in (PRESETS / f"{name}.yaml").read_text().splitlines())
    assert "Reached by" in text
    assert "driver canopen" in text or "driver serial_dac" in text
    assert config.safety.encoder_jump is not None
    assert config.safety.max_velocity is not None
    assert config.safety.encoder_jump > config.safety.max_velocity * config.period / config.raw_resolution
    # as much as its own plant can take away: Coulomb friction holds half a tick of the spring
    assert config.spring.stiffness * config.resolution < 2.0 * config.plant.coulomb


def test_numbers_of_the_rigs_follow_from_their_sources() -> None:
    srv02, hapkit, mj5208, epos4 = (load_config(name) for name in ("srv02", "hapkit", "mj5208", "epos4"))
    assert srv02.amplifier.torque_constant == pytest.approx(0.90 * 0.69 * 70 * 7.68e-3, rel=0.002)
    assert srv02.plant.inertia == pytest.approx(9.76e-5 + 0.90 * 70**2 * (3.90e-7 + 7.06e-8), rel=0.002)
    assert hapkit.amplifier.peak_current == pytest.approx(0.03 * 73.152 / 4.191, rel=0.01)
    assert hapkit.encoder.counts_per_rev == round(360 / 0.01197)
    assert mj5208.amplifier.torque_constant == pytest.approx(3**0.5 / 2 * 60 / (2 * pi) / 330, rel=0.002)
    friction = epos4.plant.coulomb + epos4.plant.viscous * 7580 * 2 * pi / 60
    assert friction == pytest.approx(0.137 * 0.0302, rel=0.01)


def test_re35_preset_is_the_default() -> None:
    assert load_config("re35") == load_config(None) == load_config() == Config()


def test_every_key_of_the_interface_has_its_default() -> None:
    text = """
servo:      {rate_hz: 1000, priority: 80, cpu: null, require_realtime: false, overrun: {policy: skip, fault_after: 50}}
spring:     {stiffness: 0.012, origin: 0.0, half_tick_bias: true, side: both}
encoder:    {counts_per_rev: 8192, decimation: 1, invert: false}
dither:     {target: none, waveform: sine, amplitude: 0.0, frequency_hz: 0.0, seed: 0}
delay:      {computation_s: 0.0}
amplifier:  {torque_constant: 0.0292, continuous_current: 2.0, peak_current: 6.0, peak_time_s: 1.0, bandwidth_hz: 3000,
             damping_ratio: 0.7, dac_bits: 14, dac_full_scale: 6.0}
plant:      {inertia: 6.28e-6, viscous: 9.0e-6, coulomb: 2.0e-3, effects: []}
hand:       {inertia: 0.0, damping: 0.0, stiffness: 0.0}
driver:     {name: loopback}
safety:     {max_velocity: 400, max_excursion: 10, encoder_jump: 8192, missed_exchanges: 2, enable_timeout_s: 2.0,
             heartbeat_timeout_s: 0.5}
record:     {enabled: true}
api:        {mode: "0660", group: null}
"""
    assert parse_yaml(text, "interface") == Config()


@pytest.mark.parametrize("name", TABLE_II)
def test_table_ii_presets_hold_the_physical_columns(name: str) -> None:
    config = load_config(name)
    inertia, viscous, coulomb, micrometres, period, stiffness = TABLE_II[name]
    assert config.is_linear
    assert (config.plant.inertia, config.plant.viscous, config.plant.coulomb) == (inertia, viscous, coulomb)
    assert config.spring.stiffness == stiffness
    assert config.resolution == pytest.approx(micrometres * 1e-6, rel=1e-15)
    assert config.period == pytest.approx(period, rel=1e-15)


@pytest.mark.parametrize("name", TABLE_II)
def test_table_ii_presets_give_the_dimensionless_numbers(name: str) -> None:
    config = load_config(name)
    plant, stiffness, period = config.plant, config.spring.stiffness, config.period
    mu = plant.inertia / (stiffness * period**2)
    beta = plant.viscous / (stiffness * period)
    sigma = plant.coulomb / (stiffness * config.resolution)
    assert (mu, beta, sigma) == pytest.approx(NUMBERS[name], rel=0.02)


@pytest.mark.parametrize("name", TABLE_II)
def test_table_ii_amplifiers_are_ideal_and_safety_is_linear(name: str) -> None:
    config = load_config(name)
    amplifier = config.amplifier
    assert (amplifier.torque_constant, amplifier.delay, amplifier.dac_bits) == (1.0, 0.0, 0)
    assert (amplifier.continuous_current, amplifier.peak_current) == (None, None)
    assert (config.safety.max_velocity, config.safety.max_excursion) == (2.0, 0.2)
    # a device at its speed limit must not look like an encoder jump
    assert config.safety.encoder_jump is not None
    assert config.safety.encoder_jump > 10 * 2.0 * config.period / config.raw_resolution


def test_derived_numbers_of_the_default() -> None:
    config = Config()
    assert config.period == 1e-3
    assert config.raw_resolution == 2 * pi / 8192
    assert config.amplifier.delay == pytest.approx(2 * 0.7 / (2 * pi * 3000), rel=1e-15)
    assert (config.is_linear, config.origin_counts) == (False, 0)


def test_derived_numbers_follow_decimation_and_origin() -> None:
    config = parse_yaml("{encoder: {counts_per_metre: 1e5, decimation: 217}, spring: {origin: -0.0123457}}", "x")
    assert config.raw_resolution == 1e-5
    assert config.resolution == 217 * 1e-5
    assert config.origin_counts == -1235


def test_linear_devices_have_safety_limits_of_their_own() -> None:
    config = parse_yaml("encoder: {counts_per_metre: 1e5}", "x")
    assert config.encoder.counts_per_rev is None
    assert (config.safety.max_velocity, config.safety.max_excursion) == (2.0, 0.2)
    given = parse_yaml("{encoder: {counts_per_metre: 1e5}, safety: {max_velocity: 5, max_excursion: null}}", "x")
    assert (given.safety.max_velocity, given.safety.max_excursion) == (5.0, None)
