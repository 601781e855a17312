"""Covariance of a fitted hypothesis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.parallel import each

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.fit import Fit

    Floats = NDArray[np.float64]

_FALL = 2.0
"""Nats by which the likelihood may fall along a secant."""
_NARROWER = 6
"""Attempts to find such a secant."""


def covariance_of(fit: Fit) -> Floats:
    """Covariance of the coordinates, shape (k, k).

    The expected information, of means and of variances, is the bread of the sandwich (White 1982); scores summed over
    blocks are between, so that it is robust to what the model has wrong about single samples and their dependence. No
    variance is less than what the model by itself says. A parameter at its bound is as uncertain as any other; the
    noise there is off.
    """
    fit.differentiate()
    free = fit.free(fit.scores.sum(axis=0)) | (np.arange(fit.u.size) >= len(NOISE))
    if any(CATALOGUE[item.slug].acts_on == "memory" for item in fit.terms if item.slug in CATALOGUE):
        _secants(fit, free)
    scores = fit.scores[:, free] - fit.scores[:, free].mean(axis=0)  # at a bound they do not sum to zero
    A = fit.information()[np.ix_(free, free)] + np.diag(fit.prior[free] ** -2.0)
    unit = 1.0 / np.sqrt(np.diag(A) + 1e-12 / fit.scale[free] ** 2)
    units = np.outer(unit, unit)
    bread = units * np.linalg.inv(A * units + 1e-9 * np.eye(unit.size))
    sums = fit.problem.series.per_block(scores)
    filling = [scores.T @ scores, sums.T @ sums]
    variances = [np.diag(bread @ part @ bread) for part in filling]
    robust = bread @ filling[1] @ bread
    largest = np.maximum(np.maximum(variances[0], variances[1]), np.diag(bread))
    told = variances[1] > 0.0
    scale = np.sqrt(largest[told] / variances[1][told])
    own = np.diag(largest)
    own[np.ix_(told, told)] = robust[np.ix_(told, told)] * np.outer(scale, scale)
    covariance = np.zeros((fit.u.size, fit.u.size))
    covariance[np.ix_(free, free)] = own
    return covariance


def _secants(fit: Fit, free: NDArray[np.bool_]) -> None:
    """Differentiate over the widest steps along which the likelihood falls by no more than `_FALL`.

    With impacts it is rough: its slope at a point says nothing of how far the data let a parameter go.
    """

    def differentiate_by(j: int) -> None:
        step = 0.1 * fit.scale[j]
        for _ in range(_NARROWER):
            sides = []
            for sign in (1.0, -1.0):
                u = fit.u.copy()
                u[j] = np.clip(u[j] + sign * step, fit.lower[j], fit.upper[j])
                sides.append((u[j], *fit.evaluate(u)))
            if fit.log_likelihood - max(value for _, value, _ in sides) < _FALL:
                break
            step *= 0.2
        (upper, _, above), (lower, _, below) = sides
        fit.set_slopes(j, above, below, upper - lower)

    each(differentiate_by, np.flatnonzero(free).tolist())
