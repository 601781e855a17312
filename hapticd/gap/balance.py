"""Inertia and friction without a model: least squares on the balance of forces.

    K_t i(t − T_D) = J a + b v + c sgn v − τ₀

Positions are smoothed by a zero-phase Butterworth filter and differentiated, currents go through the same filter, and
samples at rest are left out, where stiction takes any value (the inverse dynamic model of Gautier 1997, as in Janot, Gautier
and Brunot, CEP 2019). Quantisation and the filter bias the result by some per cent. It does not depend on the model, so it
is a start for the likelihood even where the model is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.arrays import Floats
    from hapticd.gap.recording import Recording

LEAST_START = 0.05
"""Least share of the torque from which a base parameter starts: the logarithm of zero does not exist."""
CUTOFF_HZ = 40.0
"""Cut-off frequency of the filter [Hz]; lower where the sampling rate is low."""
MOVING = 4.0
"""Speed, in encoder cells per filter time constant, above which the shaft counts as moving."""
_LONGEST_DELAY_S = 0.01
"""Largest delay that is tried [s], or this many periods, whichever is more:"""
_LONGEST_DELAY_PERIODS = 6.0
_FEWEST_ROWS = 100
NEAR_LEAST = 1.1
"""A delay is as good as the best one up to this ratio of their residual RMS."""
_ROWS_PER_CUTOFF = 5.0
"""Rows used per period of the cut-off frequency: more rows add no information."""


@dataclass(frozen=True)
class Solution:
    """Estimates from the balance of forces at one delay and one sign of the encoder.

    Attributes:
        inertia: J in kg m² or kg, > 0. viscous: b. coulomb: c. bias: τ₀, with the corrected sign of the encoder.
        delay_s: from sample to current.
        sign: 1, or −1 where the encoder counts against the torque.
        explained: explained fraction of the driving torque's power, at most 1. left: RMS of the residual, N m or N.
    """

    inertia: float
    viscous: float
    coulomb: float
    bias: float
    delay_s: float
    sign: int
    explained: float
    left: float


@dataclass(frozen=True)
class Balance(Solution):
    """The best solution over all delays and both signs.

    Attributes:
        explained_other_sign: `explained` with the other sign.
        at_delays: (m, 5) inertia, viscous, coulomb, bias and delay_s at every delay that was tried.
    """

    explained_other_sign: float
    at_delays: Floats


@dataclass(frozen=True)
class Smoothed:
    """A filtered recording on a regular time grid, for the balance of forces; all arrays (n,).

    Attributes:
        time_s: the grid. position, velocity, acceleration: filtered. direction: sign of the velocity, filtered.
        torque: of the recorded current. moves: whether the shaft moves. period_s: of the grid. cutoff_hz: of the filter.
    """

    time_s: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    direction: Floats
    torque: Floats
    moves: NDArray[np.bool_]
    period_s: float
    cutoff_hz: float

    @property
    def taken(self) -> NDArray[np.int64]:
        """Rows that enter the least squares."""
        every = max(1, round(1.0 / (_ROWS_PER_CUTOFF * self.cutoff_hz * self.period_s)))
        return np.flatnonzero(self.moves)[::every]

    def torque_at(self, delay_s: float) -> Floats:
        """Torque with a delay from sample to current; the zero-order hold adds half a period."""
        return np.interp(self.time_s - delay_s - 0.5 * self.period_s, self.time_s, self.torque)


def delays(period_s: float) -> Floats:
    """The delays from sample to current to try [s]."""
    longest = max(_LONGEST_DELAY_S, _LONGEST_DELAY_PERIODS * period_s)
    return np.arange(0.0, longest, max(0.25 * period_s, 2.5e-4))


def balance(recordings: Sequence[Recording], torque_constant: float) -> Balance:
    """Inertia, friction, bias, delay and the encoder's sign by least squares.

    Args:
        recordings: of one device.
        torque_constant: K_t, N m/A or N/A, assumed known.

    Raises:
        RecordingError: the shaft hardly moves, or the current is zero while it moves.
    """
    parts = [smoothed(recording, torque_constant) for recording in recordings]
    if sum(int(part.moves.sum()) for part in parts) < _FEWEST_ROWS:
        names = ", ".join(recording.name for recording in recordings)
        raise RecordingError(f"{names}: the shaft moves in too few samples for an identification; record more motion")
    period = parts[0].period_s
    found = [[_solve(parts, delay, sign) for delay in delays(period)] for sign in (1, -1)]
    tried, others = sorted(found, key=lambda of_sign: -max(one.explained for one in of_sign))
    best, other = _with_the_least_delay(tried), max(others, key=lambda one: one.explained)
    drive = float(np.sqrt(np.mean(np.concatenate([part.torque[part.moves] for part in parts]) ** 2)))
    if drive == 0.0:
        names = ", ".join(recording.name for recording in recordings)
        raise RecordingError(f"{names}: the current is 0 A while the shaft moves; its inertia is not identifiable")
    columns = np.concatenate([np.stack([p.acceleration, p.velocity])[:, p.moves] for p in parts], axis=1)
    size = np.sqrt(np.mean(columns**2, axis=1))
    at_delays = np.array([[one.inertia, one.viscous, one.coulomb, one.bias, one.delay_s] for one in tried])
    least = LEAST_START * drive / np.append(size, 1.0)
    at_delays[:, :3] = np.maximum(at_delays[:, :3], least)
    J, b, c, bias, delay_s = at_delays[tried.index(best)].tolist()
    return Balance(J, b, c, bias, delay_s, best.sign, best.explained, best.left, other.explained, at_delays)


def _with_the_least_delay(of_sign: Sequence[Solution]) -> Solution:
    """The solution with the shortest delay that is as good as the best: in closed loop, delay and inertia are correlated."""
    least = min(one.left for one in of_sign)
    return next(one for one in of_sign if one.left <= NEAR_LEAST * least)


def smoothed(recording: Recording, torque_constant: float) -> Smoothed:
    """Position, its derivatives and torque after the same zero-phase filter."""
    from scipy.signal import butter, sosfiltfilt

    T, time_s = recording.period_s, recording.time_s
    cutoff = min(CUTOFF_HZ, 0.1 / T)
    sos = butter(2, cutoff, fs=1.0 / T, output="sos")
    grid = np.arange(time_s[0], time_s[-1], T)
    position = sosfiltfilt(sos, np.interp(grid, time_s, recording.position))
    velocity = np.gradient(position, T)
    row = np.clip(np.searchsorted(time_s, grid, side="right") - 1, 0, time_s.size - 1)
    current = recording.current if recording.added is None else recording.current + recording.added
    torque = sosfiltfilt(sos, torque_constant * current[row])
    slowest = MOVING * max(recording.resolution, 1e-12) * cutoff
    rests = np.abs(velocity) < slowest
    direction = sosfiltfilt(sos, np.where(rests, 0.0, np.sign(velocity)))
    width = 2 * round(0.5 / (cutoff * T)) + 1
    near_rest = np.convolve(rests, np.ones(width), "same") > 0.5
    return Smoothed(grid, position, velocity, np.gradient(velocity, T), direction, torque, ~near_rest, T, cutoff)


def _solve(parts: Sequence[Smoothed], delay_s: float, sign: int) -> Solution:
    """Least squares at one delay and sign."""
    from scipy.optimize import lsq_linear

    rows, wanted = [], []
    for part in parts:
        late = part.torque_at(delay_s)
        motion = np.stack([part.acceleration, part.velocity, part.direction])
        rows.append(np.concatenate([sign * motion, -np.ones((1, late.size))])[:, part.taken].T)
        wanted.append(late[part.taken])
    A, y = np.concatenate(rows), np.concatenate(wanted)
    scale = np.sqrt(np.mean(A**2, axis=0)) + 1e-300
    found = lsq_linear(A / scale, y, bounds=([0.0, 0.0, 0.0, -np.inf], np.inf))
    J, b, c, bias = found.x / scale
    left = float(np.mean((y - A @ (found.x / scale)) ** 2))
    power = float(np.mean(y**2))
    explained = 1.0 - left / power if power > 0.0 else 0.0
    return Solution(float(J), float(b), float(c), float(bias), float(delay_s), sign, explained, float(np.sqrt(left)))
