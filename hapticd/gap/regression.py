"""Least squares on autocorrelated residuals: block cross-validation, and standard errors robust to autocorrelation.

Rows of a filtered record are not independent (neighbours correlate at 0.45 on EMPS), so an information criterion that
counts them accepts nonsense. Here whole blocks of at least a second are the unit: they are left out together, and the
covariance of the estimate sums the scores of blocks (Liang and Zeger 1986), which needs no model of the correlation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

BLOCK_S = 1.0
_FEWEST_BLOCKS = 10
_RIDGE = 1e-10
"""Of the columns' own squares: two columns that are the same share the estimate instead of exploding."""


@dataclass(frozen=True)
class Blocks:
    """Which block of time, and which fold of blocks, each row belongs to.

    Attributes:
        number: (m,) block of each row, from 0 without gaps. fold: (m,) fold of each row. folds: how many.
    """

    number: NDArray[np.int64]
    fold: NDArray[np.int64]
    folds: int

    @classmethod
    def of(cls, time_s: FloatArray, folds: int = 5, block_s: float = BLOCK_S) -> Blocks:
        """Blocks of ``block_s``, or shorter ones so that there are ten; neighbours go to different folds."""
        span = float(time_s[-1] - time_s[0])
        width = min(block_s, span / _FEWEST_BLOCKS) if span > 0.0 else 1.0
        _, number = np.unique(((time_s - time_s[0]) / width).astype(np.int64), return_inverse=True)
        folds = min(folds, int(number[-1]) + 1)
        return cls(number, number % folds, folds)

    def then(self, other: Blocks) -> Blocks:
        """These rows followed by those of another recording, whose blocks are others."""
        number = np.concatenate([self.number, other.number + self.number[-1] + 1])
        return Blocks(number, np.concatenate([self.fold, other.fold]), max(self.folds, other.folds))


@dataclass(frozen=True)
class Estimate:
    """A least-squares fit: (k,) coefficients, their standard errors, and (m,) residuals."""

    coefficients: FloatArray
    standard_errors: FloatArray
    residual: FloatArray

    @property
    def rms(self) -> float:
        """RMS of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))


def solve(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Coefficients (k,) of columns (m, k) that explain a target (m,) best; a column of zeros gets 0."""
    scale = np.sqrt(np.sum(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    unit = columns / scale
    gram = unit.T @ unit
    gram[np.diag_indices_from(gram)] += _RIDGE
    return np.asarray(np.linalg.solve(gram, unit.T @ target) / scale)


def estimate(columns: FloatArray, target: FloatArray, blocks: Blocks) -> Estimate:
    """Fit all rows; standard errors from the scores of blocks, with the small-sample factor G/(G−1)."""
    coefficients = solve(columns, target)
    residual = target - columns @ coefficients
    scale = np.sqrt(np.sum(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    unit = columns / scale
    groups = int(blocks.number.max()) + 1
    scores = np.zeros((groups, columns.shape[1]))
    np.add.at(scores, blocks.number, unit * residual[:, None])
    gram = unit.T @ unit
    gram[np.diag_indices_from(gram)] += _RIDGE
    bread = np.linalg.inv(gram)
    covariance = bread @ (scores.T @ scores) @ bread * groups / max(groups - 1, 1)
    return Estimate(coefficients, np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale, residual)


def cross_validated(columns: FloatArray, target: FloatArray, blocks: Blocks) -> FloatArray:
    """Residual (m,) of each row under the coefficients that were fitted without its fold."""
    residual = np.empty_like(target)
    for fold in range(blocks.folds):
        held = blocks.fold == fold
        if not held.any():
            continue
        coefficients = solve(columns[~held], target[~held]) if not held.all() else np.zeros(columns.shape[1])
        residual[held] = target[held] - columns[held] @ coefficients
    return residual


def block_gain(before: FloatArray, after: FloatArray, blocks: Blocks) -> tuple[float, float]:
    """Share of the squared residual that went away, and how sure a gain is, in standard errors.

    The second is Student's t of the blocks' (before − after)/(before + after), which weighs a calm block like a lively
    one: a few blocks of strong excitation make most of the share, and say little of how often there is a gain.
    """
    first, second = (np.bincount(blocks.number, residual**2) for residual in (before, after))
    total = float(first.sum())
    relative = (first - second) / np.maximum(first + second, 1e-300)
    spread = float(np.std(relative, ddof=1)) / np.sqrt(relative.size) if relative.size > 1 else 0.0
    share = 1.0 - float(second.sum()) / total if total > 0.0 else 0.0
    return share, float(relative.mean() / spread) if spread > 0.0 else 0.0


def lag_one(residual: FloatArray) -> float:
    """Correlation of neighbouring residuals."""
    centred = residual - residual.mean()
    power = float(centred @ centred)
    return float(centred[1:] @ centred[:-1]) / power if power > 0.0 else 0.0
