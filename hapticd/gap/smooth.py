"""Position, velocity and acceleration of a quantised record: a zero-phase low-pass, and a smoother that knows quantisation.

The low-pass is what force and regressors go through alike: filtering is linear, so a balance of forces that holds holds
filtered, at every bandwidth. It does not hold for sgn or products of filtered signals; those are formed from the
smoothed state first, and filtered then.

The smoother is a Kalman filter with a Rauch–Tung–Striebel pass for the model "jerk is white noise", computed as the
banded least-squares problem it is equivalent to (Whittaker 1923, Rauch, Tung and Striebel 1965): the path of the
smallest third differences from which the samples differ by as much as their noise. A sample is the cell it lies in, not
the cell's centre: only what sticks out of the cell counts as a difference. It finds its own bandwidth, and its velocity
is about as good as that of a low-pass whose bandwidth was chosen knowing the truth, better on slow motion
(tests/gap/test_smooth.py); so it is what the nonlinear regressors are formed from.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, pi, sqrt
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.signal import butter, sosfiltfilt

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.data import Recording

    FloatArray = NDArray[np.float64]

ORDER = 4
"""Of the Butterworth low-pass, before it is run both ways."""

_ON_GRID = 1e-3
"""Stamps this close to a uniform grid, in periods, are taken as they are."""
_SHARE_OF_NOISE = 0.02
"""The bandwidth is chosen so that quantisation makes this share of the RMS force."""
_CELL_PASSES = 12
_CELL_WEIGHT = 0.1
"""Cells pull less than their centres do; with this much less smoothness the two are in balance again."""
_STRETCH = 100


@dataclass(frozen=True)
class Motion:
    """A record on a uniform grid of n instants.

    Attributes:
        time_s: (n,). period_s: distance of the instants.
        measured: (n,) position as measured, interpolated where the stamps jitter, rad or m.
        position: (n,) smoothed. velocity: (n,) its central difference. acceleration: (n,) its second difference.
        noise: standard deviation of one measured position.
    """

    time_s: FloatArray
    period_s: float
    measured: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    noise: float


class LowPass:
    """A zero-phase Butterworth low-pass with decimation, for everything that is compared.

    Args:
        bandwidth_hz: where it has fallen to one half. period_s: of the signals.
    """

    def __init__(self, bandwidth_hz: float, period_s: float) -> None:
        self.bandwidth_hz = bandwidth_hz
        self.every = max(1, int(1.0 / (2.5 * bandwidth_hz * period_s)))
        self._sections = butter(ORDER, bandwidth_hz, fs=1.0 / period_s, output="sos")
        self._edge = round(1.0 / (bandwidth_hz * period_s))
        self._ringing = 4 * self._edge

    def rows(self, samples: int) -> slice:
        """The decimated rows: without the ends, where the filter has only one side to look at."""
        return slice(self._ringing, samples - self._ringing, self.every)

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Filter a signal (n,) and return its decimated rows (m,)."""
        padding = min(3 * self._edge + 9, signal.size - 1)
        return np.asarray(sosfiltfilt(self._sections, signal, padlen=padding)[self.rows(signal.size)])


def uniform(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """A uniform grid of instants at the median period, and the measured position there (cubic where stamps jitter)."""
    period = recording.period_s
    grid = recording.time_s[0] + period * np.arange(int(recording.duration_s / period + 0.5) + 1)
    if grid.size == recording.rows and float(np.abs(grid - recording.time_s).max()) < _ON_GRID * period:
        return grid, recording.position
    grid = grid[grid <= recording.time_s[-1]]
    return grid, np.asarray(CubicSpline(recording.time_s, recording.position)(grid))


def held_mean(recording: Recording, signal: FloatArray, grid: FloatArray, delay_s: float) -> FloatArray:
    """Mean around each instant of the grid of a signal (n,) that is held from sample to sample, later by a delay.

    The second difference of a position averages the acceleration over the period before and the one after (with
    triangular weight); a held force averages to the mean of its two values there, exactly on a uniform record.
    """
    since = recording.time_s + delay_s
    integral = np.concatenate([[0.0], np.cumsum(signal[:-1] * np.diff(since))])
    half = 0.5 * (grid[1] - grid[0])
    edges = np.concatenate([[grid[0] - 2.0 * half], grid, [grid[-1] + 2.0 * half]])
    row = np.clip(np.searchsorted(since, edges, side="right") - 1, 0, since.size - 1)
    reached = integral[row] + signal[row] * (edges - since[row])
    return np.asarray((reached[2:] - reached[:-2]) / (4.0 * half))


def velocity_of(position: FloatArray, period_s: float) -> FloatArray:
    """Central difference (n,); one-sided at the ends."""
    return np.asarray(np.gradient(position, period_s))


def acceleration_of(position: FloatArray, period_s: float) -> FloatArray:
    """Second difference (n,); repeated at the ends."""
    inner = np.diff(position, 2) / period_s**2
    return np.concatenate([inner[:1], inner, inner[-1:]])


def position_noise(recording: Recording) -> float:
    """Standard deviation of one position: the cell's Δ/√12, or more where fourth differences show more.

    Differences of smooth motion vanish with their order and noise does not; the median over short stretches leaves out
    those with impacts.
    """
    fourth = np.diff(recording.position, 4)
    stretches = fourth[: fourth.size // _STRETCH * _STRETCH].reshape(-1, _STRETCH)
    floor = recording.resolution / sqrt(12.0)
    if stretches.size == 0:
        return floor
    return max(floor, sqrt(float(np.median(np.mean(stretches**2, axis=1))) / comb(8, 4)))


def default_bandwidth(recording: Recording, inertia: float, force_rms: float) -> float:
    """Bandwidth in Hz: at most a tenth of the sampling rate, and so low that noise of position stays below the force.

    White noise σ of the position has the power 2 T σ² per Hz, and makes up to a frequency B an inertial force of
    m σ (2πB)² √(2BT/5).
    """
    rate = 1.0 / recording.period_s
    noise = inertia * position_noise(recording) * (2.0 * pi) ** 2 * sqrt(2.0 * recording.period_s / 5.0)
    if noise <= 0.0 or force_rms <= 0.0:
        return rate / 10.0
    return float(np.clip((_SHARE_OF_NOISE * force_rms / noise) ** 0.4, rate / 100.0, rate / 10.0))


def motion_of(recording: Recording) -> Motion:
    """Smoothed motion of a recording on a uniform grid.

    Raises:
        ValueError: fewer than 8 samples, from which no motion can be smoothed.
    """
    grid, measured = uniform(recording)
    if grid.size < 8:
        raise ValueError(f"{recording.name}: {grid.size} samples are too few to smooth")
    noise = position_noise(recording)
    position = smoothed(measured, noise, 0.5 * recording.resolution)
    period = recording.period_s
    velocity, acceleration = velocity_of(position, period), acceleration_of(position, period)
    return Motion(grid, period, measured, position, velocity, acceleration, noise)


def smoothed(measured: FloatArray, noise: float, half_cell: float) -> FloatArray:
    """Smoothest path through noisy quantised samples on a uniform grid.

    Args:
        measured: (n,) centres of cells, n ≥ 8. noise: standard deviation of one.
        half_cell: half the width of a cell.

    Returns:
        (n,) positions. The weight of smoothness is the largest at which the samples differ from the path by no more
        than their noise (the discrepancy principle, Morozov 1966), found by bisection.
    """
    if noise <= 0.0:
        return measured
    centred = measured - measured.mean()
    low, high = -4.0, 14.0
    while high - low > 0.1:
        middle = 0.5 * (low + high)
        path = _Whittaker(centred.size, 10.0**middle)(centred)
        low, high = (middle, high) if np.sqrt(np.mean((path - centred) ** 2)) < noise else (low, middle)
    cells = half_cell > 0.0 and noise < 2.0 * half_cell
    smoother = _Whittaker(centred.size, 10.0**low * (_CELL_WEIGHT if cells else 1.0))
    path = smoother(centred)
    for _ in range(_CELL_PASSES if cells else 0):
        path = smoother(np.clip(path, centred - half_cell, centred + half_cell))
    return np.asarray(path + measured.mean())


class _Whittaker:
    """Minimises Σ (y − x)² + weight · Σ (Δ³x)²."""

    def __init__(self, samples: int, weight: float) -> None:
        pattern = np.array([-1.0, 3.0, -3.0, 1.0])
        bands = np.zeros((4, samples))
        for offset in range(4):
            for first in range(4 - offset):
                product = pattern[first] * pattern[first + offset]
                bands[3 - offset, first + offset : samples - 3 + first + offset] += product
        bands *= weight
        bands[3] += 1.0
        self._factor = cholesky_banded(bands)

    def __call__(self, values: FloatArray) -> FloatArray:
        return np.asarray(cho_solve_banded((self._factor, False), values))
