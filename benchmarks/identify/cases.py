"""Hidden devices, drawn over two decades of inertia and of friction, recorded by the independent integrator."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap import devices, physics, session
from benchmarks.gap.devices import Model
from benchmarks.gap.disturbance import Coloured, disturbed
from benchmarks.gap.physics import OMEGA, STATE_WORDS, THETA, Device, Loop

INERTIA = (6e-7, 6e-5)
COULOMB = (2e-4, 2e-2)
VISCOUS = (1e-6, 1e-4)
COUNTS_PER_REV = (2000, 8192, 40000)
LARGEST_BIAS = 0.3
"""Over Coulomb friction."""
LONGEST_DELAY_S = 1.5e-3
WRONG = 100.0
"""Factor by which the config's plant may be wrong, either way."""
COLOURED_SHARE = 0.05
COLOURED_S = (0.01, 0.05, 0.2)
NOISE_COUNTS = 0.1
STEP_S = 5e-6
_FASTEST = 400.0
_FARTHEST = 100.0
_GENTLER = ((1.0, 1.0), (2.0, 0.7), (4.0, 0.5), (10.0, 0.5), (30.0, 0.4), (100.0, 0.4))
"""Softness of the spring and scale of the amplitudes, in the order in which a lab would try them."""
_DRAWS = 5
_SHORTER = (1.0, 0.5, 0.25)
"""Share of the duration: a light device with much friction runs away in a long push."""


class Hidden(NamedTuple):
    """One device, and what is told of it.

    `counts` already have the sign with which they were recorded; `config` is what the user had before: right in resolution
    and torque constant, wrong in the plant.
    """

    seed: int
    truth: dict[str, float]
    inverted: bool
    coloured: Coloured | None
    config: Model
    time_s: NDArray[np.float64]
    counts: NDArray[np.int64]
    current: NDArray[np.float64]


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def hidden(seed: int, duration_s: float = 20.0) -> Hidden:
    """Draw a device and record a session of it; every other seed has a coloured torque that no model knows.

    A device that runs away in every session is drawn anew: a lab would not have a recording of it.

    Raises:
        ValueError: no session is gentle enough for any of a few devices.
    """
    for draw in range(_DRAWS):
        found = _drawn(seed, draw, duration_s)
        if found is not None:
            return found
    raise ValueError(f"seed {seed}: no session is gentle enough")


def _drawn(seed: int, draw: int, duration_s: float) -> Hidden | None:
    rng = np.random.default_rng([seed, 0x1D, draw] if draw else [seed, 0x1D])
    nominal = devices.model("re35")
    nominal["encoder"]["counts_per_rev"] = int(COUNTS_PER_REV[seed % 3])
    plant = {
        "inertia": _log_uniform(rng, *INERTIA),
        "viscous": _log_uniform(rng, *VISCOUS),
        "coulomb": _log_uniform(rng, *COULOMB),
    }
    nominal["plant"] = plant
    bias = LARGEST_BIAS * plant["coulomb"] * rng.uniform(-1.0, 1.0)
    device = devices.base_device(nominal)
    delay = device.delay_s + rng.uniform(0.0, LONGEST_DELAY_S)
    device = device._replace(bias=bias, delay_s=delay)
    inverted = bool(rng.random() < 0.5)
    coloured = Coloured(COLOURED_SHARE, float(rng.choice(COLOURED_S))) if seed % 2 else None
    truth = {**plant, "bias": bias, "delay_s": delay}
    wrong = {key: value * _log_uniform(rng, 1.0 / WRONG, WRONG) for key, value in plant.items()}
    device = disturbed(device, coloured, plant["coulomb"], duration_s + 1.0, seed)
    recorded = _recorded(device, nominal, duration_s, seed)
    if recorded is None:
        return None
    time_s, counts, current = recorded
    config = {**nominal, "plant": wrong}
    return Hidden(seed, truth, inverted, coloured, config, time_s, -counts - 1 if inverted else counts, current)


def _recorded(
    device: Device, nominal: Model, duration_s: float, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]] | None:
    for share, (softness, scale) in itertools.product(_SHORTER, _GENTLER):
        rng = np.random.default_rng([seed, 0x5E])
        drawn = session.draw(nominal, share * duration_s, rng, softness, scale)
        n = drawn.times.size
        noise = rng.normal(0.0, 1.0, n) * NOISE_COUNTS * device.resolution
        start = np.zeros(STATE_WORDS)
        start[THETA] = rng.uniform(0.0, 1.0) * device.resolution
        amplifier = nominal["amplifier"]
        loop = Loop(
            stiffness=drawn.stiffness,
            torque_constant=amplifier["torque_constant"],
            decimation=1,
            dac_step=devices.dac_step(nominal),
            peak_current=amplifier["peak_current"],
            max_omega=_FASTEST,
            max_theta=_FARTHEST,
        )
        lost = np.zeros(n, dtype=bool)
        found = physics.run(device, loop, drawn.times, drawn.extra, drawn.origin, lost, noise, start, STEP_S)
        counts, commanded, _, states, done = found
        if done == n and np.ptp(states[:, OMEGA]) > 0.0:
            return drawn.times, counts, commanded
    return None
