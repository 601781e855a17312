"""What machines are made to do: references of position, and torques. All of shape (n,)."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks.gap.foreign.simulate import Floats


def sines(t: Floats, travel: float, speed: float, rng: np.random.Generator) -> Floats:
    """Some sines of different periods: the speed is reached, the travel is not exceeded."""
    slow = speed / travel / (2.0 * np.pi)
    frequencies = slow * rng.uniform(0.5, 1.0) * np.cumprod(np.append(1.0, rng.uniform(1.5, 2.6, 3)))
    weights = rng.uniform(0.5, 1.0, 4) / frequencies
    found = (weights[:, None] * np.sin(2.0 * np.pi * frequencies[:, None] * t + rng.uniform(0, 6.28, (4, 1)))).sum(
        axis=0
    )
    return _begun(_sized(found, t, travel, speed), t)


def moves(t: Floats, travel: float, speed: float, rng: np.random.Generator) -> Floats:
    """Point to point at trapezoids of velocity, some slow and some fast, with rests."""
    found, now, here = np.empty(t.size), 0.0, 0.0
    instants, places = [0.0], [0.0]
    while now < t[-1]:
        there = rng.uniform(-travel, travel)
        now += abs(there - here) / (speed * rng.choice([0.15, 0.4, 0.7, 1.0, 1.0])) + 1e-3
        instants.append(now)
        places.append(there)
        now += rng.choice([0.02, 0.2, 0.5])
        instants.append(now)
        places.append(there)
        here = there
    found = np.interp(t, instants, places)
    ramp = rng.uniform(0.05, 0.15)  # a running mean of a ramp is a trapezoid of velocity
    width = max(1, round(ramp / (t[1] - t[0])))
    padded = np.concatenate([np.full(width - 1, found[0]), found])
    summed = np.cumsum(np.append(0.0, padded))
    return np.asarray((summed[width:] - summed[:-width]) / width)


def sweep(t: Floats, travel: float, speed: float, rng: np.random.Generator) -> Floats:
    """A sine whose frequency rises: travel first, speed from then on."""
    low = speed / travel / (2.0 * np.pi) * rng.uniform(0.2, 0.5)
    frequency = low * rng.uniform(6.0, 15.0) ** (t / t[-1])
    phase = 2.0 * np.pi * np.cumsum(frequency) * (t[1] - t[0])
    amplitude = np.minimum(travel, speed / (2.0 * np.pi * frequency))
    return _begun(amplitude * np.sin(phase), t)


def levels(t: Floats, travel: float, speed: float, rng: np.random.Generator) -> Floats:
    """Speeds one after the other, both ways, with ramps between: what a speed loop is given. The travel is not kept."""
    longest = rng.uniform(0.5, 1.5)
    instants, speeds = [0.0], [0.0]
    while instants[-1] < t[-1]:
        ramp = rng.uniform(0.05, 0.3)
        wanted = speed * rng.uniform(0.08, 1.0) * rng.choice([-1.0, 1.0])
        instants += [instants[-1] + ramp, instants[-1] + ramp + rng.uniform(0.3, 1.0) * longest]
        speeds += [wanted, wanted]
    return np.asarray(np.cumsum(np.interp(t, instants, speeds)) * (t[1] - t[0]))


def triangle(t: Floats, height: float, rng: np.random.Generator) -> Floats:
    """Slow triangles both ways with rests of seconds between."""
    instants, values = [0.0, rng.uniform(0.5, 1.5)], [0.0, 0.0]
    while instants[-1] < t[-1]:
        flank, peak = rng.uniform(0.6, 1.5), height * rng.uniform(0.7, 1.0)
        for _ in range(int(rng.integers(1, 3))):
            for side in (1.0, -1.0):
                instants += [instants[-1] + flank, instants[-1] + 2.0 * flank]
                values += [side * peak, 0.0]
        instants.append(instants[-1] + rng.uniform(1.0, 3.0))
        values.append(0.0)
    return np.interp(t, instants, values)


def wander(n: int, tick_s: float, size: float, rng: np.random.Generator) -> Floats:
    """A torque that nothing explains: an Ornstein–Uhlenbeck process of 10 to 100 ms."""
    keep = np.exp(-tick_s / rng.uniform(0.01, 0.1))
    noise = rng.normal(size=n) * size * np.sqrt(1.0 - keep * keep)
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0], [1.0, -keep], noise))


def smooth_noise(t: Floats, high_hz: float, rng: np.random.Generator) -> Floats:
    """Noise below a frequency, RMS 1."""
    found = sosfiltfilt(butter(2, high_hz, fs=1.0 / (t[1] - t[0]), output="sos"), rng.normal(size=t.size))
    return np.asarray(found / found.std())


def _sized(found: Floats, t: Floats, travel: float, speed: float) -> Floats:
    fastest = np.abs(np.gradient(found, t)).max()
    return np.asarray(found * min(travel / np.abs(found).max(), speed / fastest))


def _begun(found: Floats, t: Floats) -> Floats:
    """From zero, within the first half second."""
    return np.asarray(found * np.clip(t / 0.5, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(t / 0.5, 0.0, 1.0)))
