"""Recordings as windows that can be predicted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.predict import segment_of
from hapticd.gap.search import Data
from hapticd.gap.windows import cut, window_length
from hapticd.plant.layout import word

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.data import Recording
    from hapticd.gap.hypothesis import Hypothesis

_SKIP = 5
"""First ticks of a recording: what the current was before them is not known."""


def prepare(recordings: Sequence[Recording], base: Hypothesis) -> Data:
    """Windows of all recordings, with quantisation as the first guess of the noise."""
    segments, blocks, first = [], [], 0
    inertia, coulomb = float(base.base[word("inertia")]), float(base.base[word("coulomb")])
    constant = float(base.base[word("torque_constant")])
    for recording in recordings:
        sigma = recording.resolution / np.sqrt(12.0) or 1e-6 * float(np.ptp(recording.position))
        force = max(coulomb, constant * float(np.sqrt(np.mean(recording.current**2))))
        length = window_length(recording.period_s, inertia, force, sigma, recording.rows)
        windows = cut(recording.rows, recording.period_s, length, _SKIP)
        segments.append(segment_of(recording, windows, sigma))
        blocks.append(windows.block + first)
        first = int(blocks[-1].max()) + 1
    return Data(segments, np.concatenate(blocks))
