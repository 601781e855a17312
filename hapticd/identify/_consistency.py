"""Consistency of the recordings with the torque constant and with each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import chance
from hapticd.gap.result import Estimate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.recording import Recording
    from hapticd.identify._base_fit import BaseFit

_BLOCKS = 10
"""Blocks for the standard error of the current's gain."""
_LATEST = 6
"""Samples by which a measured current may be late."""
_MATERIAL = 0.05
"""Relative difference of two runs' inertia over torque constant that is reported."""
_CERTAIN = 4.0
"""Standard errors that this difference must exceed."""


def current_gain(recordings: Sequence[Recording]) -> Estimate | None:
    """Measured over commanded current, at the lag of the best agreement; None without a measured current."""
    pairs = [(r.current, r.current_measured) for r in recordings if r.current_measured is not None]
    pairs = [(sent, seen) for sent, seen in pairs if np.any(seen != 0.0) and np.ptp(sent) > 0.0]
    if not pairs:
        return None
    best: tuple[float, float, float] | None = None
    for lag in range(_LATEST):
        sent = np.concatenate([a[: a.size - lag] for a, _ in pairs])
        seen = np.concatenate([b[lag:] for _, b in pairs])
        gain = float(sent @ seen / (sent @ sent))
        left = seen - gain * sent
        if best is None or float(left @ left) < best[0]:
            parts = np.array_split(sent * left, _BLOCKS)
            spread = np.sqrt(sum(float(part.sum()) ** 2 for part in parts)) / float(sent @ sent)
            best = float(left @ left), gain, float(spread)
    assert best is not None
    _, gain, spread = best
    half = chance.standard_errors(0.025, _BLOCKS) * spread
    return Estimate(gain, (gain - half, gain + half), "A/A")


def disagreeing_runs(found: BaseFit, names: Sequence[str]) -> list[str]:
    """Warnings about runs whose ratio of inertia to torque constant differs from that of all runs together."""
    series, S = found.fit.problem.series, found.scores()
    doubts = []
    for number, name in enumerate(names if len(names) > 1 else ()):
        own = S[series.recording == number]
        H = own.T @ own
        diagonal = np.diag(H)
        inverse = np.linalg.inv(H + 1e-9 * np.diag(diagonal) + 1e-300 * np.eye(diagonal.size))
        step = float((inverse @ own.sum(axis=0))[0]) / float(found.values[0])
        error = np.sqrt(max(inverse[0, 0], 0.0) + found.covariance[0, 0]) / float(found.values[0])
        if abs(step) > max(_MATERIAL, _CERTAIN * error):
            doubts.append(
                f"{name}: its ratio of inertia to torque constant is {100 * abs(step):.0f} % "
                f"{'larger' if step > 0.0 else 'smaller'} than that of all runs together: another load or amplifier setting?"
            )
    return doubts
