"""Each law of the benchmark's own physics against its formula, written out here with numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.gap import devices
from benchmarks.gap.hidden import LAWS, hide
from benchmarks.gap.physics import (
    Device,
    accelerations,
    bristle_after,
    coulomb_level,
    delivered_current,
    drive,
    joint,
    measured,
)

BASE = Device(inertia=2e-5, viscous=3e-5, coulomb=4e-3, torque_constant=0.05, delay_s=1e-4, resolution=1e-3)
T, THETA, OMEGA, CURRENT = 2.0, 0.7, -5.0, 0.3
BASE_DRIVE = 0.05 * 0.3 + 3e-5 * 5.0


def hidden(name: str, **parameters: object) -> Device:
    return hide(BASE, [{"name": name, **parameters}])


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        ("viscous_friction", {"r": 2.0}, 0.05 * 0.3 + 9e-5 * 5.0),
        ("torque_constant_error", {"r": 0.5}, 0.075 * 0.3 + 3e-5 * 5.0),
        ("asymmetric_coulomb", {"a": 0.2}, BASE_DRIVE - 0.2 * 4e-3),
        ("asymmetric_viscous", {"a": 0.4}, 0.05 * 0.3 + 3e-5 * 0.6 * 5.0),
        ("quadratic_drag", {"d": 2e-5}, BASE_DRIVE + 2e-5 * 25.0),
        ("constant_bias", {"tau_0": -1e-3}, BASE_DRIVE - 1e-3),
        ("gravity", {"m_g_l": 3e-3, "theta_0": 0.2}, BASE_DRIVE - 3e-3 * math.sin(0.5)),
        (
            "torque_ripple",
            {"orders": [7, 3], "amplitudes": [1e-3, 5e-4], "phases": [0.3, -1.0]},
            BASE_DRIVE + 1e-3 * math.sin(4.9 + 0.3) + 5e-4 * math.sin(2.1 - 1.0),
        ),
        ("return_spring", {"k_s": 0.01, "theta_0": 0.1}, BASE_DRIVE - 0.01 * 0.6),
        (
            "hand_impedance",
            {"m_h": 1e-5, "b_h": 2e-5, "k_h": 0.02, "on_s": 1.5, "off_s": 2.5, "rest": 0.2},
            BASE_DRIVE + 2e-5 * 5.0 - 0.02 * 0.5,
        ),
        ("hand_impedance", {"m_h": 1e-5, "b_h": 2e-5, "k_h": 0.02, "on_s": 0, "off_s": 1, "rest": 0.2}, BASE_DRIVE),
    ],
)
def test_torques_other_than_dry_friction(name: str, parameters: dict[str, object], expected: float) -> None:
    assert drive(hidden(name, **parameters), T, THETA, OMEGA, CURRENT) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        ("coulomb_friction", {"r": 0.5}, 6e-3),
        ("stribeck", {"s": 0.4, "omega_s": 10.0}, 4e-3 * (1 + 0.4 * math.exp(-0.25))),
        ("load_dependent_friction", {"kappa": 0.1}, 4e-3 + 0.1 * 0.05 * 0.3),
        ("thermal_drift", {"r": -0.5, "t_w": 4.0}, 4e-3 * (1 - 0.5 * (1 - math.exp(-0.5)))),
    ],
)
def test_dry_friction(name: str, parameters: dict[str, object], expected: float) -> None:
    assert coulomb_level(hidden(name, **parameters), T, OMEGA, CURRENT) == pytest.approx(expected, rel=1e-12)


def test_inertia_and_hand_inertia_divide_the_torque() -> None:
    sliding = (BASE_DRIVE + 4e-3) / 2e-5
    assert accelerations(BASE, T, THETA, OMEGA, 0, 0, 0, CURRENT, -1.0)[0] == pytest.approx(sliding, rel=1e-12)
    heavier = hidden("inertia_error", r=1.0)
    assert accelerations(heavier, T, THETA, OMEGA, 0, 0, 0, CURRENT, -1.0)[0] == pytest.approx(sliding / 2, rel=1e-12)
    held = hidden("hand_impedance", m_h=6e-5, b_h=0.0, k_h=0.0, on_s=1, off_s=3, rest=0.0)
    assert accelerations(held, T, THETA, OMEGA, 0, 0, 0, CURRENT, -1.0)[0] == pytest.approx(sliding / 4, rel=1e-12)


def test_bristle_settles_at_the_breakaway_displacement_and_carries_the_friction() -> None:
    d = hidden("presliding", breakaway=2e-3, sigma_1=1e-3)
    assert bristle_after(d, T, 0.0, OMEGA, 0.0, 10.0) == pytest.approx(-2e-3, rel=1e-12)
    assert bristle_after(d, T, 0.0, 1e-3, 0.0, 1.0) == pytest.approx(2e-3 * (1 - math.exp(-0.5)), rel=1e-12)
    z = 5e-4
    z_rate = OMEGA - abs(OMEGA) * z / 2e-3
    friction = 4e-3 / 2e-3 * z + 1e-3 * z_rate
    expected = (BASE_DRIVE - friction) / 2e-5
    assert accelerations(d, T, THETA, OMEGA, z, 0, 0, CURRENT, 0.0)[0] == pytest.approx(expected, rel=1e-12)


def test_backlash_is_free_inside_the_play_and_only_pushes() -> None:
    d = hidden("backlash", gap=4e-3, load_share=0.25)
    assert joint(d, 1.9e-3, 50.0) == joint(d, -1.9e-3, -50.0) == 0.0
    assert joint(d, 2.1e-3, -1e3) == 0.0
    reduced = 2e-5 * 0.25 * 0.75
    assert joint(d, 2.1e-3, 0.0) == pytest.approx(1e-4 * reduced * (2 * math.pi * 1500) ** 2, rel=1e-9)
    assert joint(d, -2.1e-3, 0.0) == pytest.approx(-joint(d, 2.1e-3, 0.0), rel=1e-9)


def test_coupling_has_its_antiresonance_where_asked() -> None:
    d = hidden("flexible_coupling", f_r=40.0, load_share=0.3, damping=0.05)
    locked = -joint(d, 1e-3, 0.0) / (0.3 * 2e-5)
    assert math.sqrt(-locked / 1e-3) / (2 * math.pi) == pytest.approx(40.0, rel=1e-12)
    assert d.joint_damping / (2 * math.sqrt(d.joint_stiffness * 0.3 * 2e-5)) == pytest.approx(0.05, rel=1e-12)


def test_the_path_of_the_current_and_of_the_measurement() -> None:
    assert delivered_current(hidden("dac_quantization", q=0.02), 0.311) == pytest.approx(0.32)
    limited = hidden("current_saturation", i_max=0.25)
    assert (delivered_current(limited, 0.3), delivered_current(limited, -0.3)) == (0.25, -0.25)
    assert hidden("transport_delay", t_d=2e-3).delay_s == pytest.approx(2.1e-3)
    eccentric = hidden("encoder_eccentricity", e=5e-3, phi=0.4, e_2=1e-3, phi_2=-0.2)
    expected = THETA + 5e-3 * math.sin(1.1) + 1e-3 * math.sin(1.2)
    assert measured(eccentric, THETA) == pytest.approx(expected, rel=1e-12)


def test_every_slug_has_a_law() -> None:
    from hapticd.config import EFFECT_SLUGS

    assert set(LAWS) == set(EFFECT_SLUGS)


def test_base_corrections_come_before_laws_that_build_on_them() -> None:
    both = [{"name": "asymmetric_coulomb", "a": 0.5}, {"name": "coulomb_friction", "r": 1.0}]
    assert hide(BASE, both).coulomb_offset == pytest.approx(0.5 * 8e-3)


def test_two_joints_are_refused() -> None:
    backlash = {"name": "backlash", "gap": 1e-3, "load_share": 0.3}
    coupling = {"name": "flexible_coupling", "f_r": 40.0, "load_share": 0.3, "damping": 0.05}
    with pytest.raises(ValueError, match="one joint"):
        hide(BASE, [backlash, coupling])


@pytest.mark.parametrize("name", devices.MODELS)
def test_every_nominal_model_is_a_valid_config(name: str) -> None:
    from hapticd.config import parse_config

    nominal = devices.model(name)
    config = parse_config(nominal, name)
    base = devices.base_device(nominal)
    assert config.raw_resolution == pytest.approx(base.resolution, rel=1e-12)
    assert config.amplifier.delay == pytest.approx(base.delay_s, rel=1e-12)
    assert config.is_linear == devices.is_linear(nominal)
    assert np.isfinite(base.inertia)
