"""What the test of the residual looks at: scores (w, k) of every window, which have mean zero where nothing is left.

For each coordinate (time, position, velocity, …) a force is imagined that is constant in each of a few ranges of it, and
another that acts against the motion there, as friction does. The normal equations of these forces on the held-out residual
give a gradient g_w of every window; whitened with the normal matrix of all, |Σ_w L⁻¹ g_w|² is the gain in loss that they
would bring.

Two scores need no coordinate. Do successive windows ask for a force of the same sign? And do the samples of a window err
together, more than in replicas of the recording that quantisation and noise alone have disturbed?
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import noise
from hapticd.gap.context import Context
from hapticd.gap.evidence import window_weight
from hapticd.gap.smooth import motion_of
from hapticd.gap.where import coordinates_at, unit_of
from hapticd.gap.windows import folds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.search import Data, Judged

    Floats = NDArray[np.float64]

_RANGES = 8
_LAGS = 8
_RIDGE = 1e-3
"""Of the information in each column: ranges that no window tells apart share what they explain."""
_UNSEEN = 1e-3
"""Ranges about which the windows say less than this share of what they say about others are left out."""


@dataclass(frozen=True)
class Scores:
    """One test.

    Attributes:
        values: (w, k). share: part of the squared residual that the dependence predicts on blocks it was not formed on.
        detail: where it is strongest, in words. one_sided: only a positive sum speaks of structure.
    """

    values: Floats
    share: float
    detail: str = ""
    one_sided: bool = False

    def statistic(self, sums: Floats) -> Floats:
        """Size (f,) of sums (f, k) of the values."""
        return np.asarray(sums[:, 0] if self.one_sided else np.einsum("fk,fk->f", sums, sums))


def all_scores(data: Data, judged: Judged, rng: np.random.Generator) -> dict[str, Scores]:
    """Every test of the held-out residual, by coordinate.

    Args:
        data: windows. judged: the model, cross-validated. rng: of the replicas.
    """
    held_out = replace(judged.fit, residuals=list(judged.held_out.residuals))
    device = judged.hypothesis.device(judged.fit.solution.u, 0).vector
    context = Context(data.segments, held_out, device)
    weight = window_weight(judged.held_out.mean_square)
    square = np.concatenate([np.einsum("wl,wl->w", r, r) for r in held_out.residuals])
    squares = float(weight @ square)
    found = {
        name: _along(context, data.block, values, squares, unit_of(name, is_linear=context.is_linear))
        for name, values in _coordinates(data).items()
    }
    found["successive"] = _successive(context, data, squares)
    found["smooth"] = _smooth(data, judged, weight, squares, rng)
    return found


def _coordinates(data: Data) -> dict[str, list[Floats]]:
    """Coordinate to its values (n,) in every recording."""
    parts = [coordinates_at(s.recording, motion_of(s.recording), s.recording.time_s) for s in data.segments]
    # How late a tick was is a matter of time stamps, not of forces.
    return {name: [part[name] for part in parts] for name in parts[0] if name != "lateness"}


def _along(context: Context, block: NDArray[np.int64], values: Sequence[Floats], squares: float, unit: str) -> Scores:
    """Forces that are constant in each range of a coordinate, along a direction and against the motion."""
    edges = np.unique(np.quantile(np.concatenate(values), np.linspace(0.0, 1.0, _RANGES + 1)))
    ranges = max(edges.size - 1, 1)
    forces = []
    for segment, value in zip(context.segments, values, strict=True):
        index = np.clip(np.searchsorted(edges, value, side="right") - 1, 0, ranges - 1)
        inside = [(index == number).astype(np.float64) for number in range(ranges)]
        forces.append([*inside, *(one * np.sign(segment.velocity) for one in inside)])
    normal, right = context.normal_of_forces(forces)
    information = np.einsum("wpp->p", normal)
    seen = np.flatnonzero(information > _UNSEEN * float(information.max()))
    if not seen.size:
        return Scores(np.zeros((len(block), 1)), 0.0)
    scale = np.sqrt(information[seen])
    right = right[:, seen] / scale
    normal = normal[:, seen][:, :, seen] / (scale[:, None] * scale)
    whole = normal.sum(axis=0) + _RIDGE * np.eye(seen.size)
    strongest = int(seen[np.argmax(np.abs(np.linalg.solve(whole, right.sum(axis=0))))]) % ranges
    detail = (
        f", most between {edges[strongest]:.3g} and {edges[strongest + 1]:.3g} {unit}".rstrip() if ranges > 2 else ""
    )
    whitened = np.linalg.solve(np.linalg.cholesky(whole), right.T).T
    return Scores(whitened, _predicted(normal, right, folds(block)) / squares, detail)


def _predicted(normal: Floats, right: Floats, fold: NDArray[np.int64]) -> float:
    """Squared residual that forces fitted to the other folds take away."""
    gain = 0.0
    for number in np.unique(fold):
        here = fold == number
        others = normal[~here].sum(axis=0)
        others[np.diag_indices_from(others)] += _RIDGE
        force = np.linalg.solve(others, right[~here].sum(axis=0))
        gain += float(2.0 * force @ right[here].sum(axis=0) - force @ normal[here].sum(axis=0) @ force)
    return gain


def _successive(context: Context, data: Data, squares: float) -> Scores:
    """Constant force of each window, in standard errors, times that of the next window of the same block."""
    normal, right = context.normal_of_forces([[np.ones(s.recording.rows)] for s in data.segments])
    force = right[:, 0] / np.sqrt(np.maximum(normal[:, 0, 0], 1e-300))
    agreement = np.where(data.block[1:] == data.block[:-1], force[1:] * force[:-1], 0.0)
    values = np.append(agreement, 0.0)[:, None]
    return Scores(values, float(values.sum()) / squares, one_sided=True)


def _smooth(data: Data, judged: Judged, weight: Floats, squares: float, rng: np.random.Generator) -> Scores:
    """Mean covariance of samples up to `_LAGS` apart in a window, above that of replicas which noise alone has disturbed."""
    fit = judged.fit
    predicted = [s.observed - r * s.sigma[:, None] for s, r in zip(data.segments, fit.residuals, strict=True)]
    values = []
    replicas = noise.replicas(data.segments, predicted, fit.at, rng)
    for residual, disturbed in zip(judged.held_out.residuals, replicas, strict=True):
        expected = np.mean([_covariance(one) for one in disturbed], axis=0)
        values.append(_covariance(residual) - expected)
    excess = (weight * np.concatenate(values))[:, None]
    return Scores(excess, float(excess.sum()) / squares, one_sided=True)


def _covariance(residual: Floats) -> Floats:
    """Sum (w,) over the samples of a window of their products with later ones, averaged over the lags."""
    lags = range(1, min(_LAGS, residual.shape[1] - 1) + 1)
    return np.asarray(sum(np.einsum("wl,wl->w", residual[:, k:], residual[:, :-k]) for k in lags) / len(lags))
