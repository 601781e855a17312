"""How surely one model predicts better than another, window by window, on data it was not fitted to.

The loss of a window is −2 log of a multivariate Student density of its L residuals e (in standard deviations),

    ℓ = (κ + 1)·L·log(1 + s/κ),   s = Σ e²/L,

which is Gaussian near s = 1 and grows only with the logarithm of a gross misfit, so that a handful of windows in which a
marginal stick or slip went the other way cannot decide.

Two models differ in a window by d = e₀ − e₁, and the loss of the first exceeds that of the second by about |d|² + 2 d·e₁
(times the robust weight). What is left of chance in this is the second term: the sum of held-out differences D is judged by

    W = D / √V,   V = max over groupings of Σ_g (Σ_{w ∈ g} ρ d·e₁)²,

with windows, quarters of a block and whole blocks as groupings, since e₁ is correlated from window to window where a
model is still incomplete, and never less than unit noise would give. If the better model is one nested coordinate away, W
is its estimate over its block-robust standard error, less what cross-validation takes off for the fit. W is referred to
Student's distribution with as many degrees of freedom as there are blocks that take part. A gain must survive the removal
of its best windows.

See docs/explanation/gap-statistics.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

KAPPA = 4.0
FALSE_ALARM = 0.005
"""Designed probability that anything of the catalogue is named when nothing is missing."""
MINIMUM_GAIN = 0.01
"""Smallest share of the squared prediction error that counts. Below it lie differences of integration, time stamps and
rounding that no physics need explain, and the bias of fits in which every window has an initial state of its own (Neyman
and Scott 1948)."""
MINIMUM_SHARE = 0.05
"""Smallest share of the error beyond noise that counts: of a model that is far off, less says nothing of what is missing."""
BEST_WINDOWS, BEST_SHARE = 4, 0.007
"""Windows without which a gain must survive, and the share of all windows where that is more. A marginal slip that goes the
right way by chance gains as much as a hundred windows of an effect, and a recording has a few of them."""
RUGGED_SHARE = 0.03
"""The same share where the model has play: an impact that is missed or imagined throws its window off under any model."""
_BEST_OF_RIVALS = 2
_GROSS = 100.0
"""Loss of a window beyond which its logarithm is at work."""


def window_loss(mean_square: NDArray[np.float64], length: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Loss of windows from their mean squared residual (in variances of one sample) and their length in samples."""
    return np.asarray((KAPPA + 1.0) * length * np.log1p(mean_square / KAPPA))


def minimum_gain(mean_square: NDArray[np.float64]) -> float:
    """Smallest gain per sample that counts, in units of the loss, for a model with these mean squares (w,).

    It is the larger of `MINIMUM_GAIN` and of `MINIMUM_SHARE` over all windows.
    """
    square = np.maximum(mean_square, 1.0)
    weight = window_weight(square)
    return max(MINIMUM_GAIN * float(np.mean(square * weight)), MINIMUM_SHARE * float(np.mean((square - 1.0) * weight)))


def window_weight(mean_square: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivative of `window_loss` by the sum of squares: the weight of a window in Gauss–Newton."""
    return np.asarray((KAPPA + 1.0) / (KAPPA + mean_square))


@dataclass(frozen=True)
class Comparison:
    """One model against another on the same held-out windows; positive speaks for the first."""

    gain: float
    """Σ of the loss differences: twice the log-likelihood ratio."""
    gain_per_sample: float
    """What survives of it without the best windows counts, at most twice."""
    needed: float
    """`minimum_gain` of the second."""
    z: float
    """Standard errors from zero, as a normal deviate."""

    def significant(self, trials: float) -> bool:
        """Whether the gain stands out, among `trials` candidates tried, at the designed false-alarm rate."""
        return self.z > threshold(trials) and self.gain_per_sample > self.needed


def few_windows(windows: int, is_rugged: bool = False) -> int:
    """So many windows decide nothing by themselves, neither for an effect nor against a model.

    Args:
        windows: of all recordings.
        is_rugged: the model has impacts, which come or stay away with the least change.
    """
    return max(BEST_WINDOWS, round((RUGGED_SHARE if is_rugged else BEST_SHARE) * windows))


def threshold(trials: float) -> float:
    """Standard errors that chance exceeds with probability `FALSE_ALARM` in `trials` tries."""
    return float(stats.norm.isf(FALSE_ALARM / max(trials, 1.0)))


@dataclass(frozen=True)
class Scored:
    """Held-out losses (w,) and residuals (w, L) of a model, in segments of equal window length."""

    loss: Floats
    mean_square: Floats
    residuals: Sequence[Floats]


def compare(
    better: Scored,
    worse: Scored,
    block: NDArray[np.int64],
    samples: float,
    are_rivals: bool = False,
    is_rugged: bool = False,
) -> Comparison:
    """Compare two models on the same held-out windows.

    Args:
        better: the model that is claimed to be better.
        worse: the other.
        block: block number (w,) of each window, unique over all recordings.
        samples: number of predicted samples in all.
        are_rivals: both explain the gap, and what decides between them may show in a few windows only.
        is_rugged: the worse model has impacts already, so that more windows than usual decide nothing.
    """
    weight = window_weight(better.mean_square)
    cross, size = [], []
    for first, second in zip(worse.residuals, better.residuals, strict=True):
        change = first - second
        cross.append(np.einsum("wl,wl->w", change, second))
        size.append(np.einsum("wl,wl->w", change, change))
    difference = worse.loss - better.loss
    design = weight * np.concatenate(size)
    # A gross misfit counts by its logarithm, and so does what chance can do to it.
    counted = np.clip(np.abs(difference) / np.maximum(design, 1e-300), 0.0, 1.0)
    noise = np.where(design > 0.0, np.where(difference > _GROSS, counted, 1.0), 0.0) * weight * np.concatenate(cross)
    design = np.where(difference > _GROSS, counted, 1.0) * design
    gain = float(difference.sum())
    needed = minimum_gain(worse.mean_square)
    if gain <= 0.0:
        return Comparison(gain, gain / samples, needed, 0.0)
    best = _BEST_OF_RIVALS if are_rivals else few_windows(len(difference), is_rugged)
    robust = gain - float(np.sort(difference)[-best:].sum())
    counted = min(gain, 2.0 * max(robust, 0.0))
    variance = max(_grouped(noise, block), float(design.sum()))
    statistic = counted / np.sqrt(variance) if variance > 0.0 else 0.0
    return Comparison(gain, counted / samples, needed, _normal_deviate(statistic, _degrees(design, block)))


def _grouped(noise: Floats, block: NDArray[np.int64]) -> float:
    """Variance of the sum of correlated terms: the largest of the estimates from windows, quarter blocks and blocks."""
    number = np.unique(block, return_inverse=True)[1]
    within = np.arange(len(block)) - np.searchsorted(number, number)
    size = np.bincount(number)[number]
    quarter = 4 * number + np.minimum(4 * within // size, 3)
    return max(float(np.sum(np.bincount(g, weights=noise) ** 2)) for g in (number, quarter, np.arange(len(block))))


def _degrees(design: Floats, block: NDArray[np.int64]) -> float:
    """Effective number of quarter blocks that take part, less one; at least three."""
    shares = np.bincount(np.unique(block, return_inverse=True)[1], weights=design)
    total = float(shares.sum())
    return max(4.0 * total**2 / float(shares @ shares) - 1.0, 3.0) if total > 0.0 else 3.0


def _normal_deviate(t: float, degrees: float) -> float:
    """The normal deviate exceeded with the same probability as `t` of Student's distribution."""
    log_tail = float(stats.t.logsf(t, degrees))
    if log_tail > -30.0:
        return float(stats.norm.isf(np.exp(log_tail)))
    return float(np.sqrt(-2.0 * log_tail - np.log(-4.0 * np.pi * log_tail)))
