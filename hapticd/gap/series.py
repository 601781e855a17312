"""The recordings as input of the filter: concatenated, as encoder cells, with blocks and folds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import constants
from hapticd.gap.checks import GAP_PERIODS
from hapticd.gap.kernel.commands import in_force, lagging, segments
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.arrays import Floats
    from hapticd.gap.recording import Recording

_LOSS = index_of("dropped_samples.p")
_DELAY, _TRANSPORT_DELAY, _LAG = index_of("delay_s"), index_of("transport_delay.t_d"), index_of("amplifier_lag.f_a")
_CACHE_SIZE = 4
_SHORTER = 0.95
_DRAW = 651
"""Seed. Of four thousand tried, it spreads events that repeat every few blocks most evenly over the folds."""
_ELECTRICAL = tuple(
    index_of(name)
    for name in (
        "delay_s",
        "transport_delay.t_d",
        "amplifier_lag.f_a",
        "amplifier_lag.delta",
        "current_saturation.i_max",
        "dac_quantization.q",
        "dropped_samples.p",
    )
)


@dataclass
class Series:
    """All samples of the recordings of one device, n in all.

    Attributes:
        time_s: (n,) from the start of each recording.
        cell: (n,) lower edge of the encoder's cell over `resolution`.
        resolution: width of a cell, rad or m.
        command: (n,) commanded current [A].
        begins: (n,) whether the state before this sample is unknown.
        recording: (n,) which recording a sample is of.
        block: (n,) number of the sample's block; samples of a block share a fold.
        fold: (blocks,) fold of each block.
        period_s: median period.
        added: (n,) current for a known additional torque, not passed through the amplifier [A].
    """

    time_s: Floats
    cell: Floats
    resolution: float
    command: Floats
    begins: NDArray[np.bool_]
    recording: NDArray[np.int64]
    block: NDArray[np.int64]
    fold: NDArray[np.int64]
    period_s: float
    added: Floats
    _currents: dict[tuple[float, ...], tuple[Floats, Floats, Floats]] = field(default_factory=dict, init=False)
    _swings: dict[tuple[tuple[int, float], ...], Floats] = field(default_factory=dict, init=False)
    _lock: Lock = field(default_factory=Lock, init=False)

    @property
    def size(self) -> int:
        """Number of samples."""
        return int(self.time_s.size)

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.fold.size)

    @property
    def duration_s(self) -> float:
        """Duration of all recordings together."""
        return float(self.time_s[np.append(np.flatnonzero(np.diff(self.recording)), -1)].sum())

    @property
    def periods_s(self) -> list[float]:
        """Median period of each recording."""
        numbers = range(int(self.recording[-1]) + 1)
        return [float(np.median(np.diff(self.time_s[self.recording == number]))) for number in numbers]

    @property
    def middle_s(self) -> Floats:
        """(n,) middle of the period after each sample."""
        return self.time_s + 0.5 * self.period_s

    def swings(self, lines: tuple[tuple[int, float], ...]) -> Floats:
        """Sine and cosine of each line in the middle of each period, shape (n, 2 lines); read only.

        Args:
            lines: number of a recording, outside of which it is 0, and frequency [Hz], each.
        """
        with self._lock:
            if lines not in self._swings:
                turns = np.multiply.outer(self.middle_s, [2.0 * np.pi * frequency for _, frequency in lines])
                found = np.stack([np.sin(turns), np.cos(turns)], axis=2)
                found *= np.equal.outer(self.recording, [number for number, _ in lines])[:, :, None]
                self._swings[lines] = np.ascontiguousarray(found.reshape(self.size, -1))
                self._swings[lines].flags.writeable = False
            return self._swings[lines]

    def subsample(self, every: int) -> Series:
        """One block of `every`, for quick comparisons; the first state of each block is unknown.

        The position of the block changes, so that it is not in step with a periodic excitation.
        """
        rows = self.block % every == (self.block // every + every // 2) % every
        block = np.unique(self.block[rows], return_inverse=True)[1]
        return replace(
            self,
            time_s=self.time_s[rows],
            cell=self.cell[rows],
            command=self.command[rows],
            added=self.added[rows],
            begins=self.begins[rows] | (np.diff(np.flatnonzero(rows), prepend=-2) > 1),
            recording=np.unique(self.recording[rows], return_inverse=True)[1],
            block=block,
            fold=self.fold[: int(block.max()) + 1],
        )

    def per_block(self, values: Floats) -> Floats:
        """Sum over the samples of each block; shape (n,) or (n, k) to (blocks,) or (blocks, k)."""
        if values.ndim == 1:
            return np.asarray(np.bincount(self.block, values, self.blocks), dtype=np.float64)
        sums = np.empty((self.blocks, values.shape[1]))
        for k, column in enumerate(values.T):
            sums[:, k] = np.bincount(self.block, column, self.blocks)
        return sums

    def standard_errors(self, gain: float, noise: Floats) -> float:
        """A gain in standard errors: twice the gain over its standard deviation, the z-statistic of a likelihood ratio.

        Args:
            gain: of one hypothesis over another, nats.
            noise: (n,) contributions to the variance of the gain if the better hypothesis is true: difference of the two
                predictions times the residual of the better one, over the variance of the other. They are summed per block,
                which is robust to correlated samples. Twice the gain is a lower bound of the variance.
        """
        blocks = self.per_block(noise)
        return 2.0 * gain / math.sqrt(max(float(blocks @ blocks), float(noise @ noise), 2.0 * abs(gain), 1e-300))

    def commands(self, filter_s: float) -> Floats:
        """(n,) currents [A] before a first-order filter with this time constant, whose output is the record; 0 for none.

        Between two samples the output moves by a fixed share of its distance to the current, which is inverted here.
        """
        if not filter_s:
            return self.command
        follows = ~self.begins[1:]
        share = -np.expm1(-np.where(follows, np.diff(self.time_s), np.inf) / filter_s)
        ahead: Floats = np.append(np.where(follows, np.diff(self.command) / share, 0.0), 0.0)
        return self.command + ahead

    def currents(self, p: Floats, filter_s: float = 0.0) -> tuple[Floats, Floats, Floats]:
        """Duration [s], motor current and its standard deviation [A] of each part of each period, shape (n, parts) each.

        Args:
            p: device vector. filter_s: time constant of the filter before the record.
        """
        key = (*p[list(_ELECTRICAL)], filter_s)
        with self._lock:
            if key not in self._currents:
                while len(self._currents) >= _CACHE_SIZE:
                    self._currents.pop(next(iter(self._currents)))
                commands = self.commands(filter_s)
                found = [
                    self._motor_current(p, commands, slice(rows[0], rows[-1] + 1))
                    for rows in (np.flatnonzero(self.recording == k) for k in range(int(self.recording[-1]) + 1))
                ]
                duration, current, spread = (np.concatenate(parts) for parts in zip(*found, strict=True))
                current += self.added[:, None]
                self._currents[key] = duration, current, spread
            return self._currents[key]

    def _motor_current(self, p: Floats, commands: Floats, rows: slice) -> tuple[Floats, Floats, Floats]:
        time_s, command = self.time_s[rows], commands[rows]
        deviation = np.zeros(time_s.size)
        if p[_LOSS] > 0.0:
            sent, command = command, np.empty(time_s.size)
            in_force(sent, p[_LOSS], command, deviation)
        delay = p[_DELAY] + p[_TRANSPORT_DELAY]
        parts = 2 if delay % self.period_s else 1
        duration, current, spread = (np.empty((time_s.size, parts)) for _ in range(3))
        segments(p, time_s, command, deviation, delay, duration, current, spread)
        if np.isfinite(p[_LAG]):
            halves = np.empty((time_s.size, 2))
            lagging(p, duration, current, halves)
            half = 0.5 * duration.sum(axis=1, keepdims=True)
            return np.repeat(half, 2, axis=1), halves, np.repeat(deviation[:, None], 2, axis=1)
        return duration, current, spread


def _folds(blocks: int) -> NDArray[np.int64]:
    """(blocks,) fold of each block: each fold once in every five blocks, in random order, and never twice in a row.

    With a fixed order, all reversals of a periodic motion could be in one fold.
    """
    drawn, found = np.random.default_rng(_DRAW), np.empty(0, dtype=np.int64)
    while found.size < blocks:
        row = drawn.permutation(constants.FOLDS)
        found = np.append(found, np.roll(row, 1) if row[0] in found[-1:] else row)
    return found[:blocks]


def series_of(recordings: Sequence[Recording]) -> Series:
    """Put recordings of one device together.

    Raises:
        ValueError: no recording.
    """
    if not recordings:
        raise ValueError("no recording to compare the model with")
    resolution = max(recording.resolution for recording in recordings)
    if resolution <= 0.0:
        # Positions are not quantised: cells far below the noise are equivalent to a density.
        bends = np.concatenate([np.diff(recording.position, 2) for recording in recordings])
        resolution = 1e-3 * float(np.sqrt(np.mean(bends**2)))
    total = sum(recording.duration_s for recording in recordings)
    length_s = min(constants.BLOCK_S, total / constants.FEWEST_BLOCKS)
    while sum(counts := [max(round(one.duration_s / length_s), 1) for one in recordings]) < constants.FEWEST_BLOCKS:
        length_s *= _SHORTER  # the rest of each recording belongs to its last block
    begins, block, number = [], [], []
    blocks = 0
    for index, recording in enumerate(recordings):
        waits = np.diff(recording.time_s, prepend=-np.inf)
        begins.append(waits > GAP_PERIODS * recording.period_s)
        own = np.minimum((recording.time_s / length_s).astype(np.int64), counts[index] - 1)
        own = np.unique(own, return_inverse=True)[1]
        block.append(own + blocks)
        blocks += int(own.max()) + 1
        number.append(np.full(recording.rows, index))
    return Series(
        time_s=np.ascontiguousarray(np.concatenate([recording.time_s for recording in recordings])),
        cell=np.concatenate([recording.position for recording in recordings]) / resolution - 0.5,
        resolution=resolution,
        command=np.ascontiguousarray(np.concatenate([recording.current for recording in recordings])),
        begins=np.concatenate(begins),
        recording=np.concatenate(number),
        block=np.concatenate(block),
        fold=_folds(blocks),
        period_s=float(np.median(np.concatenate([np.diff(recording.time_s) for recording in recordings]))),
        added=np.concatenate(
            [np.zeros(recording.rows) if recording.added is None else recording.added for recording in recordings]
        ),
    )
