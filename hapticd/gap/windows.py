"""Cut a recording into short windows, blocks of windows, and folds of blocks.

A window is predicted as a whole from the recorded current and an initial state of its own; limit cycles and unstable
loops make one long simulation meaningless, and a short window keeps an error of force from growing without bound.
A block is the unit of independence: quantisation errors and unmodelled forces are correlated from window to window,
so every statistic is formed on blocks, and a fold leaves out whole blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

FOLDS = 5
_SHORTEST_SAMPLES = 20
_SHORTEST_S, _LONGEST_S = 0.03, 0.25
# A constant force error f bends a window of length T by an RMS of f·T²/(12·√5·m) from the best initial state.
_BEND = 12.0 * sqrt(5.0)
_RESOLVED = 100.0
"""The typical force is to bend a window by this many standard deviations of one position sample."""
_BLOCK_S = 1.0
_FEWEST_BLOCKS = 10
_THIN, _RUN_S, _SHORTEST_RUN = 3, 0.5, 4
_WORST, _BAD = 0.05, 4.0
"""Share of all windows, and mean square, of those that are badly predicted."""


@dataclass(frozen=True)
class Windows:
    """Windows of one recording: tick `start[j]` holds the initial state, the `length` ticks after it are predicted."""

    start: NDArray[np.int64]
    length: int
    block: NDArray[np.int64]
    """Number of the block each window lies in, from 0."""

    @property
    def rows(self) -> NDArray[np.int64]:
        """Indices (w, length) of the predicted ticks."""
        return np.asarray(self.start[:, None] + np.arange(1, self.length + 1))


def window_length(period_s: float, inertia: float, force: float, sigma: float, samples: int) -> int:
    """Samples a window should have for the force to show well above the position's noise.

    Args:
        period_s: sampling period [s].
        inertia: inertia or mass [kg m² or kg].
        force: size of the forces at work [N m or N].
        sigma: standard deviation of one position sample [rad or m].
        samples: length of the recording; at least ten windows are kept.
    """
    seconds = sqrt(_BEND * inertia * _RESOLVED * sigma / force) if force > 0.0 else _LONGEST_S
    seconds = min(max(seconds, _SHORTEST_S), _LONGEST_S)
    return int(max(_SHORTEST_SAMPLES, min(round(seconds / period_s), samples // 10)))


def cut(samples: int, period_s: float, length: int, skip: int = 0) -> Windows:
    """Cut `samples` ticks into windows of `length`, leaving out the first `skip` ticks.

    Blocks last a second, or a tenth of a shorter recording, and at least two windows.
    """
    count = max((samples - 1 - skip) // length, 1)
    start = skip + length * np.arange(count, dtype=np.int64)
    seconds = min(_BLOCK_S, count * length * period_s / _FEWEST_BLOCKS)
    per_block = max(2, round(seconds / (length * period_s)))
    return Windows(start, length, np.arange(count, dtype=np.int64) // per_block)


def folds(block: NDArray[np.int64]) -> NDArray[np.int64]:
    """Fold of each window: every `FOLDS`-th block belongs to one fold, so that each fold spans the whole recording."""
    return np.asarray(block % min(FOLDS, int(block.max()) + 1))


def thinned(length_s: float, mean_square: NDArray[np.float64]) -> NDArray[np.bool_]:
    """A third of the windows, in runs of half a second, and the worst besides.

    A load that rings needs some time to be where it is; and an effect may show in a second of the recording only, as a
    saturation does.

    Args:
        length_s: of a window [s].
        mean_square: of every window (w,), in variances of a sample, of the present model.
    """
    count = len(mean_square)
    run = max(_SHORTEST_RUN, round(_RUN_S / length_s))
    mask = np.asarray(np.arange(count) // run % _THIN == 0)
    worst = np.argsort(-mean_square)[: round(_WORST * count)]
    mask[worst[mean_square[worst] > _BAD]] = True
    return mask
