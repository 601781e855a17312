"""Held-out losses by block cross-validation, and parameter uncertainty from the scores of blocks.

Refitting a converged fit without one fold moves it by a Newton step on the normal equations of the other folds: no fold
needs a fit of its own, only a prediction of the windows it leaves out. The initial state of a held-out window is fitted
to that window under either model, so its two degrees of freedom cancel in a comparison.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from hapticd.gap.evidence import Scored
from hapticd.gap.fit import damped_step, moved_states, settled
from hapticd.gap.windows import folds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.fit import Fit
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]


def held_out(segments: Sequence[Segment], fit: Fit, block: NDArray[np.int64]) -> Scored:
    """Losses of all windows, each predicted with coordinates fitted to the other folds."""
    solution = fit.solution
    if not len(solution.u):
        return Scored(solution.loss, solution.mean_square, tuple(fit.residuals))
    fold = folds(block)
    parts = np.cumsum([s.count for s in segments])[:-1]
    loss, square = np.empty_like(solution.loss), np.empty_like(solution.mean_square)
    residuals = [np.empty_like(r) for r in fit.residuals]
    for number in np.unique(fold):
        others, here = fold != number, fold == number
        step = damped_step(fit.at.hessian[others].sum(0), fit.at.gradient[others].sum(0), 1e-6)
        target = solution.hypothesis.bounded(solution.u + step)
        states = moved_states(segments, solution, fit.residuals, fit.at, target - solution.u)
        there, found = settled(segments, solution.hypothesis, target, states, solution, fit.at)
        loss[here], square[here] = there.loss[here], there.mean_square[here]
        for kept, fresh, mask in zip(residuals, found, np.split(here, parts), strict=True):
            kept[mask] = fresh[mask]
    return Scored(loss, square, tuple(residuals))


def covariance(fit: Fit, block: NDArray[np.int64]) -> tuple[Floats, int]:
    """Covariance of the coordinates and its degrees of freedom.

    The sandwich H⁻¹ (Σ_b g_b g_bᵀ) H⁻¹ over blocks b (Liang and Zeger 1986), which holds when residuals are correlated
    within a block and unequal between blocks, with the small-sample factor B/(B − P); never smaller than what
    independent residuals of unit variance would give divided by their number's own correlation.
    """
    at = fit.at
    parameters = len(fit.solution.u)
    number = np.unique(block, return_inverse=True)[1]
    blocks = int(number.max()) + 1
    scores = np.zeros((blocks, parameters))
    np.add.at(scores, number, at.gradient)
    # Zero mean by construction at the optimum; at a bound it is not, and the mean is no noise.
    scores -= scores.mean(axis=0)
    degrees = max(blocks - parameters, 1)
    hessian = at.hessian.sum(0)
    diagonal = np.diag(hessian).copy()
    diagonal[diagonal <= 0.0] = np.inf
    scale = 1.0 / np.sqrt(diagonal)
    inverse = np.linalg.pinv(hessian * scale[:, None] * scale[None, :], rcond=1e-10, hermitian=True)
    inverse = scale[:, None] * inverse * scale[None, :]
    return inverse @ (scores.T @ scores) @ inverse * (blocks / degrees), degrees


def interval_factor(degrees: int, level: float = 0.95) -> float:
    """Half width of a two-sided interval in standard errors."""
    return float(stats.t.ppf(0.5 + 0.5 * level, degrees))
