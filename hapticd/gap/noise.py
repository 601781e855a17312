"""The noise of one position sample, and the prediction error that noise alone would leave: the noise floor.

A sample is the centre of the quantisation cell, so its error has variance δ²/12 when the cells are crossed fast, plus
sensor noise, plus velocity² times the variance of unrecorded time jitter. Fourth differences of the prediction error wipe
out what a wrong force does within five ticks (a cubic) and keep what is new in every sample.

At low speed the quantisation error is not white, a fitted initial state swallows much of it, and formulae fail; so the
floor is simulated: the model's own prediction plus noise is quantised and the initial states are fitted again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from hapticd.gap.fit import Tangent
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]

_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
_GROUPS = 8
_REPLICAS = 12


@dataclass(frozen=True)
class Noise:
    """Variances of the error of a position sample beyond quantisation."""

    sensor: float
    """Variance of noise independent of speed [rad² or m²]."""
    jitter: float
    """Variance of the instant of sampling [s²]."""

    def extra(self, speed: Floats) -> Floats:
        """Variance beyond quantisation at a speed."""
        return np.asarray(self.sensor + self.jitter * speed**2)


def _median_of_mean_square(count: int) -> float:
    """Median of the mean of squares of fourth differences of white noise, relative to its expectation."""
    rng = np.random.default_rng(12345)
    white = rng.standard_normal((4000, count + 4))
    differences = np.apply_along_axis(np.convolve, 1, white, _FOURTH, "valid")
    return float(np.median(np.mean(differences**2, axis=1)) / (_FOURTH @ _FOURTH))


def estimate(error: Floats, speed: Floats, crossings: Floats, resolution: float) -> Noise:
    """Estimate the noise beyond quantisation from prediction errors of a first model.

    Args:
        error: prediction errors (w, L) [rad or m]; smooth errors of the model do not matter.
        speed: mean speed (w,) [rad/s or m/s] of each window.
        crossings: quantisation cells crossed per tick (w,).
        resolution: width δ of a quantisation cell [rad or m].
    """
    differences = np.apply_along_axis(np.convolve, 1, error, _FOURTH, "valid")
    power = np.mean(differences**2, axis=1) / (_FOURTH @ _FOURTH)
    # A slow crossing is a single step, whose fourth difference is (1, −3, 3, −1).
    quantisation = resolution**2 * np.minimum(1.0 / 12.0, 20.0 / 70.0 * np.minimum(crossings, 1.0))
    factor = _median_of_mean_square(differences.shape[1])
    order = np.argsort(speed)
    rows, values = [], []
    for group in np.array_split(order, min(_GROUPS, max(1, len(order) // 8))):
        # Too few crossings in a window make the median of its power zero, whatever the noise.
        total = float(np.median(power[group])) / factor
        rows.append([1.0, float(np.median(speed[group] ** 2))])
        values.append(max(total - float(np.median(quantisation[group])), 0.0))
    matrix, right = np.array(rows), np.array(values)
    # Relative weights: a group of fast windows would else outvote all slow ones.
    weight = 1.0 / (right + resolution**2 / 12.0)
    scale = np.array([1.0, max(float(matrix[:, 1].max()), 1e-300)])
    solved, _ = nnls(matrix / scale * weight[:, None], right * weight)
    sensor, jitter = solved / scale
    return Noise(float(sensor), float(jitter))


def replicas(
    segments: Sequence[Segment], predicted: Sequence[Floats], at: Tangent, rng: np.random.Generator
) -> Iterator[list[Floats]]:
    """Residuals (w, L) in standard deviations that noise and quantisation alone leave, a dozen times for each segment."""
    for segment, position, jacobian, gain in zip(segments, predicted, at.state_jacobian, at.state_gain, strict=True):
        true = segment.within_cell(position)
        found = []
        for _ in range(_REPLICAS):
            error = (segment.remeasured(true, rng) - position) / segment.sigma[:, None]
            found.append(error - np.einsum("wli,wi->wl", jacobian, np.einsum("wil,wl->wi", gain, error)))
        yield found


def floor(
    segments: Sequence[Segment], predicted: Sequence[Floats], at: Tangent, rng: np.random.Generator
) -> list[Floats]:
    """Mean squares (w, replicas) that noise and quantisation alone leave after fitting initial states, by segment."""
    return [
        np.stack([np.mean(left**2, axis=1) for left in found], axis=1)
        for found in replicas(segments, predicted, at, rng)
    ]
