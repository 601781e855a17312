"""Runs of an independent little simulation: explicit steps of 50 µs, friction by a smooth sign, quantised by flooring."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hapticd.config import Config, parse_config
from hapticd.gap.recording import Recording

INERTIA, VISCOUS, COULOMB, TORQUE_CONSTANT = 2.0e-5, 4.0e-5, 1.5e-3, 0.03
COUNTS = 8192
PERIOD = 1e-3
STEPS = 20

Torque = Callable[[float, float, float], float]
"""Extra torque from angle, velocity and time."""


def model(**plant: float) -> Config:
    values = {"inertia": INERTIA, "viscous": VISCOUS, "coulomb": COULOMB} | plant
    amplifier = {"torque_constant": TORQUE_CONSTANT, "bandwidth_hz": 0, "dac_bits": 0}
    return parse_config({"encoder": {"counts_per_rev": COUNTS}, "plant": values, "amplifier": amplifier}, "synthetic")


def nothing(angle: float, velocity: float, time: float) -> float:
    return 0.0


def drive(seconds: float, seed: int, size: float = 0.35) -> NDArray[np.float64]:
    """A current of a few slow sines, different for every seed."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    waves = [np.sin(2 * np.pi * hz * time + rng.uniform(0, 2 * np.pi)) for hz in (0.37, 0.9, 2.3, 5.1)]
    return np.asarray(size * (0.6 * waves[0] + 0.5 * waves[1] + 0.4 * waves[2] + 0.25 * waves[3]))


def run(
    extra: Torque = nothing, seconds: float = 20.0, seed: int = 1, centring: float = 0.05, size: float = 0.35
) -> Recording:
    """A recording under `drive` and a weak centring spring of the controller, in A/rad, which keeps the shaft near zero."""
    planned = drive(seconds, seed, size)
    current, counts = np.zeros(planned.size), np.zeros(planned.size, dtype=np.int64)
    angle = velocity = 0.0
    resolution, dt = 2 * math.pi / COUNTS, PERIOD / STEPS
    for row, wanted in enumerate(planned):
        counts[row] = math.floor(angle / resolution)
        current[row] = wanted - centring * (counts[row] + 0.5) * resolution
        push = TORQUE_CONSTANT * current[row]
        for step in range(STEPS):
            friction = VISCOUS * velocity + COULOMB * math.tanh(velocity / 0.02)
            torque = push - friction + extra(angle, velocity, (row + step / STEPS) * PERIOD)
            velocity += dt * torque / INERTIA
            angle += dt * velocity
    time = np.arange(planned.size) * PERIOD
    position = (counts + 0.5) * resolution
    return Recording("synthetic", time, position, resolution, current, None, PERIOD, False)
