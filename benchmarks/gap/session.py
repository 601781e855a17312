"""What a lab plays in an identification session: slow ramps, to-and-fro sweeps, a chirp, random steps, releases.

A table like that of ``hapticd excite``: extra current and displacement of the spring's origin, in an order and with
amplitudes drawn by seed, sized for the nominal model.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap import devices
from benchmarks.gap.devices import Model

Floats = NDArray[np.float64]

_SHARES = {"sweep": 0.3, "chirp": 0.2, "steps": 0.2, "release": 0.15, "ramp": 0.15}
_PAUSE_S = 0.2
_SPEEDS = np.array([1, 2, 3, 5, 8])
_EFFORT = {"ramp": 4.0, "chirp": 2.0, "steps": 4.0}
_LEAST_COUNTS = 300.0


class Session(NamedTuple):
    """One drawn session."""

    times: Floats
    """Instants of the ticks, s, with what they are late by."""
    lateness: Floats
    """How late each tick is, s."""
    extra: Floats
    """Excitation current, A."""
    origin: Floats
    """Displacement of the spring's origin, raw counts."""
    stiffness: float
    """Of the virtual spring."""


def triangle(cycles: Floats) -> Floats:
    """Triangular wave of period 1 and amplitude 1 that begins at 0 and rises."""
    return 1.0 - 4.0 * np.abs((cycles + 0.25) % 1.0 - 0.5)


def sweep(u: Floats) -> Floats:
    """Five constant speeds to and fro, an equal share of the time each; ``u`` runs from 0 to 1."""
    part = np.minimum((u * _SPEEDS.size).astype(int), _SPEEDS.size - 1)
    return triangle((u * _SPEEDS.size - part) * _SPEEDS[part])


def chirp(u: Floats, duration_s: float, low_hz: float, high_hz: float) -> Floats:
    """Sine whose frequency rises exponentially from low to high."""
    growth = math.log(high_hz / low_hz)
    return np.sin(2.0 * np.pi * low_hz * duration_s / growth * np.expm1(growth * u))


def steps(u: Floats, duration_s: float, rng: np.random.Generator) -> Floats:
    """Levels of a quarter second each, alternately to both sides, of random height."""
    count = max(4, 2 * int(duration_s / 0.5))
    levels = rng.uniform(0.25, 1.0, count) * np.where(np.arange(count) % 2, -1.0, 1.0)
    return levels[np.minimum((u * count).astype(int), count - 1)]


def release(u: Floats) -> Floats:
    """The origin jumps to both sides and back."""
    pattern = np.array([0.0, 1.0, 0.0, -1.0, 0.0, 0.5, 0.0, -0.5])
    return pattern[np.minimum((u * pattern.size).astype(int), pattern.size - 1)]


def lateness(ticks: int, rate_hz: float, rng: np.random.Generator) -> Floats:
    """Lateness of every tick: a few µs mostly, now and then some hundred, never a whole period."""
    late = rng.exponential(8e-6, ticks)
    disturbed = rng.random(ticks) < 0.002
    late[disturbed] += rng.exponential(2e-4, int(disturbed.sum()))
    return np.minimum(late, 0.8 / rate_hz)


def stiffness_of(nominal: Model, softness: float) -> float:
    """Of the virtual spring: the model's, or less where the shaft would hardly move."""
    effective = 4.0 * nominal["plant"]["coulomb"] / (_LEAST_COUNTS * devices.resolution(nominal))
    return float(min(nominal["spring"]["stiffness"], effective) / softness)


def travel_of(nominal: Model, stiffness: float) -> float:
    """How far the spring's origin is moved, rad or m: some counts, and beyond friction."""
    far = max(5.0 * nominal["plant"]["coulomb"] / stiffness, 400.0 * devices.resolution(nominal))
    return float(min(far, 0.4 * nominal["safety"]["max_excursion"]))


def _amplitudes(nominal: Model, stiffness: float, scale: float, rng: np.random.Generator) -> dict[str, float]:
    plant, amplifier = nominal["plant"], nominal["amplifier"]
    breakaway = plant["coulomb"] / amplifier["torque_constant"]
    found = dict.fromkeys(("sweep", "release"), travel_of(nominal, stiffness))
    found |= {name: effort * breakaway for name, effort in _EFFORT.items()}
    largest = 0.8 * (amplifier["continuous_current"] or math.inf)
    drawn = {name: value * scale * rng.uniform(0.7, 1.4) for name, value in found.items()}
    return drawn | {name: min(drawn[name], largest) for name in _EFFORT}


def draw(
    nominal: Model, duration_s: float, rng: np.random.Generator, softness: float = 1.0, scale: float = 1.0
) -> Session:
    """Draw a session for a nominal model.

    Args:
        nominal: the model.
        duration_s: of the recording.
        rng: source of order, amplitudes and lateness.
        softness: the virtual spring's stiffness is that of the model divided by this, or less where the shaft would
            hardly move.
        scale: of the amplitudes.
    """
    rate = nominal["servo"]["rate_hz"]
    ticks = round(duration_s * rate)
    stiffness = stiffness_of(nominal, softness)
    amplitude = _amplitudes(nominal, stiffness, scale, rng)
    extra, origin = np.zeros(ticks), np.zeros(ticks)
    begin = 0.0
    for name in rng.permutation(list(_SHARES)):
        length = _SHARES[name] * duration_s - _PAUSE_S
        first, last = round(begin * rate), round((begin + length) * rate)
        u = np.arange(last - first) / (last - first)
        if name == "chirp":
            wave = chirp(u, length, 0.5, min(40.0, rate / 10.0))
        elif name == "steps":
            wave = steps(u, length, rng)
        else:
            wave = {"sweep": sweep, "release": release, "ramp": triangle}[name](u)
        if name in ("sweep", "release"):
            origin[first:last] = np.rint(amplitude[name] * wave / devices.resolution(nominal))
        else:
            extra[first:last] = amplitude[name] * wave
        begin += _SHARES[name] * duration_s
    late = lateness(ticks, rate, rng)
    return Session(np.arange(ticks) / rate + late, late, extra, origin, stiffness)
