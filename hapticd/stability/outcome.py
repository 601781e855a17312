"""Outcome of a run: monotone, decaying, persistent or growing, from the energy at the samples (Fig. 6, 7).

The rules have no absolute thresholds: they compare energies of one run with each other.

1. ``growing``: the run exceeded the limit of the simulation (10⁹ ticks), or its energy is NaN.
2. At rest (velocity zero, and stiction holds every later force): ``monotone`` if the energy H_T (35) never
   rose from one sample to the next, else ``decaying``.
3. Still moving: the second half of the run is divided into six stretches, and the largest energy of each is taken.

   * They rise one after the other, by more than 1 % in total: growing, unless the rise slows down so that its geometric
     extrapolation ends below twice the last value; then the run settles into a cycle: ``persistent``.
   * They fall one after the other, by more than 1 % in total: ``monotone`` or ``decaying``, unless the extrapolation of
     the fall ends above half the last value; then ``persistent``.
   * Otherwise the energy recurs: ``persistent``.

A rise counts when it exceeds the rounding of the simulation, 10⁻⁹ of the energy. Because a trend is extrapolated and not
compared with a fixed level, a longer run changes the verdict only at the boundary itself.
"""

from __future__ import annotations

import itertools
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Outcome = Literal["monotone", "decaying", "persistent", "growing"]

#: Outcomes in the order of their codes.
OUTCOMES: Final = ("monotone", "decaying", "persistent", "growing")
MONOTONE, DECAYING, PERSISTENT, GROWING = range(4)

#: A smaller relative rise of the energy is rounding.
RISE_TOLERANCE: Final = 1e-9
#: Stretches into which the second half of a run is cut.
STRETCHES: Final = 6
#: A smaller relative trend over the second half is no trend.
TREND_TOLERANCE: Final = 0.01
#: Extrapolated value of a trend, relative to its last value, below which it vanishes; above the inverse it grows.
VANISHING: Final = 0.5

# A stretch is then 32 to 64 blocks, so that its edges are accurate to 3 %.
_BLOCKS: Final = 768


def energy_rises(energy: FloatArray, tolerance: float = RISE_TOLERANCE) -> NDArray[np.bool_]:
    """Where the energy rises from one sample to the next beyond rounding.

    Args:
        energy: (n,) or (..., n) energies at successive samples, any unit.
        tolerance: rise, relative to the energy before it, that is not counted.

    Returns:
        (..., n − 1) whether ``energy[k + 1] > energy[k] (1 + tolerance)``.
    """
    return np.asarray(energy[..., 1:] > energy[..., :-1] * (1.0 + tolerance))


def decide(rose: bool, peaks: FloatArray, at_rest: bool, grew_past_limit: bool) -> Outcome:
    """The outcome from the summary of a run.

    Args:
        rose: whether the energy ever rose between two successive samples.
        peaks: (STRETCHES,) largest energy in each stretch of the second half of the run, oldest first.
        at_rest: the mass is at rest and stiction holds every later force.
        grew_past_limit: the run ended because it exceeded the limit.
    """
    if grew_past_limit or not np.all(np.isfinite(peaks)):
        return "growing"
    calm: Outcome = "decaying" if rose else "monotone"
    if at_rest:
        return calm
    trend = _trend(peaks)
    if trend > 0:
        return "growing"
    return calm if trend < 0 else "persistent"


def _trend(peaks: FloatArray) -> int:
    """+1 growing, −1 vanishing, 0 recurring."""
    steps = np.diff(peaks)
    change = peaks[-1] - peaks[0]
    if abs(change) <= TREND_TOLERANCE * max(peaks[0], peaks[-1]):
        return 0
    direction = 1 if change > 0.0 else -1
    if not np.all(direction * steps > 0.0):
        return 0
    third = peaks[1::2]
    first_step, last_step = third[1] - third[0], third[2] - third[1]
    ratio = last_step / first_step
    end = direction * np.inf if ratio >= 1.0 else third[2] + last_step * ratio / (1.0 - ratio)
    if direction > 0:
        return 1 if end > third[2] / VANISHING else 0
    return -1 if end < third[2] * VANISHING else 0


class OutcomeTracker:
    """Outcome of a run of any length from its energies, chunk by chunk, in bounded memory.

    It stores the peaks of blocks of equal length; at 768 blocks, neighbours are merged and the length doubles.

    Attributes:
        samples: number of energies. rises: number of rises from one sample to the next.

    Example:
        >>> tracker = OutcomeTracker()
        >>> tracker.update(np.array([3.0, 2.0, 1.0]))
        >>> tracker.update(np.array([0.5, 0.5]))
        >>> tracker.outcome(at_rest=True)
        'monotone'
    """

    def __init__(self) -> None:
        self._peaks = np.empty(_BLOCKS, dtype=np.float64)
        self._blocks = 0
        self._length = 1
        self._partial = -np.inf
        self._partial_count = 0
        self._last: float | None = None
        self.rises = 0
        self.samples = 0

    def update(self, energy_chunk: FloatArray) -> None:
        """Process the next energies, (n,) in time order; n may be 0 and may differ from call to call."""
        chunk = np.asarray(energy_chunk, dtype=np.float64)
        if chunk.size == 0:
            return
        if self._last is not None and chunk[0] > self._last * (1.0 + RISE_TOLERANCE):
            self.rises += 1
        self.rises += int(np.count_nonzero(energy_rises(chunk)))
        self._last = float(chunk[-1])
        self.samples += chunk.size
        while chunk.size:
            chunk = chunk[self._absorb(chunk) :]

    def _absorb(self, chunk: FloatArray) -> int:
        """Merge the first samples of a chunk into the block peaks; returns their number."""
        if self._blocks == _BLOCKS:
            self._peaks[: _BLOCKS // 2] = self._peaks.reshape(-1, 2).max(axis=1)
            self._blocks = _BLOCKS // 2
            self._length *= 2
        whole = min(_BLOCKS - self._blocks, chunk.size // self._length)
        if self._partial_count == 0 and whole:
            taken = whole * self._length
            self._peaks[self._blocks : self._blocks + whole] = chunk[:taken].reshape(whole, -1).max(axis=1)
            self._blocks += whole
            return taken
        taken = min(self._length - self._partial_count, chunk.size)
        self._partial = max(self._partial, float(chunk[:taken].max()))
        self._partial_count += taken
        if self._partial_count == self._length:
            self._peaks[self._blocks] = self._partial
            self._blocks += 1
            self._partial, self._partial_count = -np.inf, 0
        return taken

    def tail_peaks(self) -> FloatArray:
        """(STRETCHES,) peaks of the stretches of the second half, within one block; a short run repeats its last ones."""
        peaks = self._peaks[: self._blocks]
        if self._partial_count:
            peaks = np.append(peaks, self._partial)
        tail = peaks[peaks.size // 2 :]
        if tail.size == 0:
            return np.zeros(STRETCHES)
        edges = [min(round(k * tail.size / STRETCHES), tail.size - 1) for k in range(STRETCHES + 1)]
        edges[-1] = tail.size
        return np.array([tail[a : max(b, a + 1)].max() for a, b in itertools.pairwise(edges)])

    def outcome(self, at_rest: bool, grew_past_limit: bool = False) -> Outcome:
        """The outcome so far; see `decide`."""
        if not at_rest and not grew_past_limit and self.rises == 0 and 0 < self.samples < 2 * STRETCHES:
            return "monotone"
        return decide(self.rises > 0, self.tail_peaks(), at_rest, grew_past_limit)
