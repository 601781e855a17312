"""Confidence intervals of the catalogue's parameters from the covariance of the fitted coordinates.

Draws from the coordinates' Student distribution are carried through to the parameters, so that an amplitude next to zero
or a frequency known to a factor of two gets the interval it has, not a symmetric one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.crossval import covariance
from hapticd.gap.fit import damped_step, fit_states, tangent
from hapticd.gap.result import Estimate

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from hapticd.gap.fit import Fit
    from hapticd.gap.hypothesis import Hypothesis, Term
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]

_DRAWS = 2000
_REPLICAS = 8
_ANGLES = ("phi", "phases", "theta_0")


@dataclass(frozen=True)
class Posterior:
    """Where the coordinates of a fit are, and how surely."""

    centre: Floats
    """(P,) corrected for the bias of the fit."""
    draws: Floats
    """(d, P) inside the box."""


def posterior(segments: Sequence[Segment], fit: Fit, block: NDArray[np.int64], seed: int) -> Posterior:
    """Bias-corrected coordinates and draws from their Student distribution.

    Every window has an initial state of its own, so a fit is biased however many windows there are (Neyman and Scott
    1948). The bias is measured: replicas of the recording are drawn from the fitted model and fitted again (parametric
    bootstrap, Efron 1979); half of it is kept as uncertainty.
    """
    solution = fit.solution
    if not len(solution.u):
        return Posterior(solution.u, np.zeros((1, 0)))
    rng = np.random.default_rng(seed)
    shifts = _replica_shifts(segments, fit, rng)
    bias = shifts.mean(axis=0)
    centre = solution.hypothesis.bounded(solution.u - bias)
    matrix, degrees = covariance(fit, block)
    matrix = matrix + np.cov(shifts, rowvar=False).reshape(matrix.shape) / len(shifts) + 0.25 * np.outer(bias, bias)
    matrix = matrix + _scatter(solution.hypothesis)
    return Posterior(centre, _draws(solution.hypothesis, centre, matrix, degrees, rng))


def _scatter(hypothesis: Hypothesis) -> Floats:
    """Covariance (P, P) of the minima among which a fit cannot tell."""
    matrix = np.zeros((len(hypothesis.coordinates), len(hypothesis.coordinates)))
    first = 0
    for term in hypothesis.terms:
        last = first + len(term.coordinates)
        if term.scatter is not None:
            matrix[first:last, first:last] = term.scatter
        first = last
    return matrix


def _replica_shifts(segments: Sequence[Segment], fit: Fit, rng: np.random.Generator) -> Floats:
    """How far (r, P) fits to replicas of the data end from the coordinates that made them."""
    solution = fit.solution
    predicted = [s.observed - r * s.sigma[:, None] for s, r in zip(segments, fit.residuals, strict=True)]
    shifts = []
    for _ in range(_REPLICAS):
        replicas = [s.seeing(s.remeasured(p, rng)) for s, p in zip(segments, predicted, strict=True)]
        there, residuals = fit_states(replicas, solution.hypothesis, solution.u, solution.states)
        at, _ = tangent(replicas, there, residuals, solution.hypothesis.steps(solution.u))
        shifts.append(damped_step(at.hessian.sum(0), at.gradient.sum(0), 1e-9))
    return np.array(shifts)


def _draws(hypothesis: Hypothesis, centre: Floats, matrix: Floats, degrees: int, rng: np.random.Generator) -> Floats:
    """Draws (d, P) of the coordinates, inside their box."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = rng.standard_normal((_DRAWS, len(centre))) @ root.T
    heavy = np.sqrt(degrees / rng.chisquare(degrees, (_DRAWS, 1)))
    return np.array([hypothesis.bounded(u) for u in centre + normal * heavy])


def estimates(hypothesis: Hypothesis, where: Posterior, term: int, is_linear: bool) -> Mapping[str, Estimate]:
    """Value, 95 % interval and unit of the parameters of one term."""
    chosen = hypothesis.terms[term]
    value = chosen.parameters(hypothesis.share(where.centre, term))
    table = [chosen.parameters(hypothesis.share(u, term)) for u in where.draws] if chosen.coordinates else []
    result = {}
    for name, centre in value.items():
        unit = _unit(chosen, name, is_linear)
        spread = _counted(chosen, name)
        if spread > 0.0 or not table:
            result[name] = Estimate(centre, (max(centre - spread, 0.0), centre + spread), unit)
            continue
        sample = np.array([row[name] for row in table])
        if name.split("[")[0] in _ANGLES and chosen.slug != "return_spring":
            sample = centre + np.angle(np.exp(1j * (sample - centre)))
        low, high = np.quantile(sample, (0.025, 0.975))
        result[name] = Estimate(centre, (float(min(low, centre)), float(max(high, centre))), unit)
    return result


def _counted(term: Term, name: str) -> float:
    """Half the 95 % interval of a parameter that was counted or chosen: its standard error comes with the form."""
    return 1.96 * float(str(term.form.get(f"{name}_standard_error", 0.0)))


def _unit(term: Term, name: str, is_linear: bool) -> str:
    bare = name.split("[")[0]
    known = next((p for p in CATALOGUE[term.slug].parameters if p.name == bare), None)
    if known is None:
        return ""
    return known.unit_linear if is_linear else known.unit
