"""A slow direct drive: a triangle of current, rests of seconds, creep before it breaks away, friction that rises from rest.

The likelihood alone prefers an inertia three times too large there, with nine times as much force missing.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest

from hapticd.config import Config, parse_config
from hapticd.gap import find_gap
from hapticd.gap.balance import balance
from hapticd.gap.recording import Recording

PERIOD_S, ROWS, STEPS = 1e-3, 20_000, 50
CELL = 3e-4
INERTIA, VISCOUS, COULOMB = 1.9e-4, 2.5e-4, 0.031


@numba.njit
def _played(torque: np.ndarray, disturbance: np.ndarray, rise: float, speed: float, stiffness: float) -> np.ndarray:
    """Positions at each tick: LuGre friction, (semi-)implicit steps of 20 µs."""
    found = np.empty(torque.size)
    h = PERIOD_S / STEPS
    x = v = z = d = 0.0
    for k in range(torque.size):
        found[k] = x
        d += disturbance[k] - d * PERIOD_S / 0.05
        for _ in range(STEPS):
            sliding = COULOMB * (1.0 - rise * math.exp(-abs(v) / speed))
            bent = (z + h * v) / (1.0 + h * stiffness * abs(v) / sliding)
            friction = stiffness * bent + 1e-3 * (bent - z) / h + VISCOUS * v
            z = bent
            v += h * (torque[k] + d - friction) / INERTIA
            x += h * v
    return found


def recorded(seed: int) -> Recording:
    """Twenty seconds under a triangle of 0.25 Hz, every fourth period at rest."""
    rng = np.random.default_rng(seed)
    time_s = PERIOD_S * np.arange(ROWS)
    triangle = rng.uniform(0.045, 0.055) * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * 0.25 * time_s))
    torque = np.where(time_s % 8.0 > 6.0, 0.0, triangle)
    disturbance = 1e-3 * math.sqrt(2.0 * PERIOD_S / 0.05) * rng.normal(size=ROWS)
    x = _played(torque, disturbance, rng.uniform(0.3, 0.6), rng.uniform(0.05, 0.2), rng.uniform(20.0, 100.0))
    return Recording("slow", time_s, np.floor(x / CELL) * CELL + 0.5 * CELL, CELL, torque, None, PERIOD_S, False)


def model(inertia: float, uncertainty: dict[str, float] | None = None) -> Config:
    ideal = {"torque_constant": 1.0, "bandwidth_hz": 0, "dac_bits": 0, "peak_current": 0, "continuous_current": 0}
    plant = {"inertia": inertia, "viscous": 2e-4, "coulomb": 0.03, "uncertainty": uncertainty or {}}
    return parse_config({"plant": plant, "amplifier": ideal}, "guess")


@pytest.mark.timeout(1200)
def test_the_inertia_is_the_one_that_leaves_less_force_and_the_friction_that_rises_is_named() -> None:
    recording = recorded(3)
    assert balance([recording], 1.0).inertia == pytest.approx(INERTIA, rel=0.03)
    found = find_gap([recording], model(2.5e-4), design=False)
    assert found.base["inertia"].value == pytest.approx(INERTIA, rel=0.05)
    stribeck = next(step for step in found.steps if step.effect == "stribeck")
    assert stribeck.parameters["s"].value < -0.3
    assert found.gap.held_out_after < 0.6 * found.gap.held_out_before
    assert any("kept between" in warning for warning in found.recording["warnings"])


def test_an_uncertainty_of_the_config_takes_the_place_of_the_balance() -> None:
    known = model(1.6e-4, {"inertia": 3e-5, "viscous": 1e-4, "coulomb": 3e-3})
    found = find_gap([recorded(3)], known, design=False)
    assert found.effects == ("stribeck",)
    assert not any("kept between" in warning for warning in found.recording["warnings"])
