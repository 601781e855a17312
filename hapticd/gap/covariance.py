"""Covariance of fitted parameters."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import constants
from hapticd.gap.imitation import imitated
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.parallel import parallel_map

if TYPE_CHECKING:
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit


def covariance_of(fit: Fit) -> Floats:
    """Covariance of the coordinates, shape (k, k).

    A jackknife over blocks (Miller, Biometrika 61, 1974); each estimate is one scoring step from the full one. It is
    robust to wrong noise models and to dependent samples. Lower bounds of each variance: the inverse information, and the
    spread over simulated recordings (parametric bootstrap). A parameter at its bound is treated like any other, except
    noise, which is off there.
    """
    fit.differentiate()
    free = fit.free(fit.scores.sum(axis=0)) | (np.arange(fit.u.size) >= len(NOISE))
    series = fit.problem.series
    # At a bound they do not sum to zero.
    scores = series.per_block(fit.scores[:, free] - fit.scores[:, free].mean(axis=0))
    ends = np.searchsorted(series.block, np.arange(series.blocks + 1))
    known = np.array([fit.information(slice(*block))[np.ix_(free, free)] for block in pairwise(ends)])
    A = known.sum(axis=0) + np.diag(fit.prior[free] ** -2.0)
    unit = 1.0 / np.sqrt(np.diag(A) + 1e-12 / fit.scale[free] ** 2)
    units = np.outer(unit, unit)
    A = A * units + 1e-9 * np.eye(unit.size)
    without = (1.0 + constants.HELD_BACK) * A - known * units
    moved = np.linalg.solve(without, (unit * scores)[..., None])[..., 0]
    jackknife = (1.0 - 1.0 / series.blocks) * moved.T @ moved
    inverse = np.linalg.inv(A)
    by_chance = _moved_by_imitations(fit)[:, free] / unit
    largest = np.max([np.diag(jackknife), np.diag(inverse), np.mean(by_chance**2, axis=0)], axis=0)
    determined = np.diag(jackknife) > 0.0
    wider = np.sqrt(largest[determined] / np.diag(jackknife)[determined])
    own = np.diag(largest)
    own[np.ix_(determined, determined)] = jackknife[np.ix_(determined, determined)] * np.outer(wider, wider)
    covariance = np.zeros((fit.u.size, fit.u.size))
    covariance[np.ix_(free, free)] = units * own
    return covariance


def _moved_by_imitations(fit: Fit) -> Floats:
    """Steps of scoring on simulated recordings (parametric bootstrap), shape (imitations, k).

    Near standstill the filter is approximate, and its estimates vary by more than the inverse information.
    """

    def moved_by(seed: int) -> Floats:
        other = fit.on(imitated(fit, seed))
        other.error = fit.error
        return other.approach(len(NOISE), 1).u - fit.u

    return np.array(parallel_map(moved_by, range(constants.IMITATIONS)))
