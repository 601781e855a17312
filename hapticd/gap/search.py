"""Try every candidate on top of a present model and judge each on held-out data.

Fits run in threads: the kernels release the GIL.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from hapticd.gap.candidates import BUILDERS
from hapticd.gap.crossval import held_out
from hapticd.gap.evidence import Comparison, Scored, compare, minimum_gain
from hapticd.gap.fit import ITERATIONS, fit
from hapticd.gap.windows import thinned

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from hapticd.gap.context import Context
    from hapticd.gap.fit import Fit, Solution
    from hapticd.gap.hypothesis import Hypothesis, Term
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]

T = TypeVar("T")
K = TypeVar("K", str, tuple[str, int])

_FIRST_LOOK = 3
"""Iterations that decide which start of a candidate is fitted to the end."""
_MANY = 6
"""Known coordinates beyond which a first look holds them all."""
_STARTS, _CLOSE = 2, 0.2
"""A second start is fitted too if its first look is within this share of the best gain."""
_HOPE = 0.4
"""Share of the smallest gain that counts which a first look must show."""
_SHARE_OF_LOOKS, _SHARE_OF_FITS = 0.08, 0.4
"""Candidates that gain less than this share of the best one's gain cannot win the round, nor tie: not fitted to the end,
and not cross-validated."""
_SHARE_OF_TRIALS = 0.25
"""The same after a fit to a third of the windows, which has converged and says more than a look."""
_SURE = 0.7
"""Share of the smallest gain that counts which such a fit must show."""
_PATIENCE = 1e-3
_HOPS, _HOP = 20, 0.03
"""Fits from elsewhere, and how far that is in a coordinate: a share of its range, or this much of a logarithm."""


@dataclass(frozen=True)
class Data:
    """All windows of all recordings."""

    segments: Sequence[Segment]
    block: NDArray[np.int64]
    """Block number (w,), unique over recordings."""

    @property
    def samples(self) -> float:
        """Number of predicted samples."""
        return float(sum(s.count * s.length for s in self.segments))


@dataclass(frozen=True)
class Judged:
    """A fitted hypothesis and its held-out losses."""

    fit: Fit
    held_out: Scored
    trials: float = 1.0

    @property
    def hypothesis(self) -> Hypothesis:
        """The hypothesis."""
        return self.fit.solution.hypothesis

    def against(self, other: Judged, data: Data) -> Comparison:
        """How much better this predicts than another."""
        rugged = other.hypothesis.is_rugged
        return compare(self.held_out, other.held_out, data.block, data.samples, is_rugged=rugged)

    def ahead_of(self, rival: Judged, data: Data) -> float:
        """Standard errors by which this predicts better than a rival, which may be in a few windows only."""
        return compare(self.held_out, rival.held_out, data.block, data.samples, are_rivals=True).z


def judge(data: Data, fitted: Fit, trials: float = 1.0) -> Judged:
    """Cross-validate a fit."""
    return Judged(fitted, held_out(data.segments, fitted, data.block), trials)


@dataclass(frozen=True)
class Few:
    """A third of the windows, and the present model on them."""

    data: Data
    states: Sequence[Floats]
    total: float
    """Loss of the present model, its coordinates and initial states fitted as those of a candidate will be."""
    needed: float
    """Gain that would count."""


def few_of(data: Data, present: Judged) -> Few:
    """Thin the windows."""
    solution = present.fit.solution
    squares = np.split(solution.mean_square, np.cumsum([segment.count for segment in data.segments])[:-1])
    masks = [thinned(segment.length_s, square) for segment, square in zip(data.segments, squares, strict=True)]
    segments = [segment.chosen(mask) for segment, mask in zip(data.segments, masks, strict=True)]
    states = [state[mask] for state, mask in zip(solution.states, masks, strict=True)]
    there = fit(segments, solution.hypothesis, solution.u, states, patience=_PATIENCE).solution
    few = Data(segments, data.block[np.concatenate(masks)])
    return Few(few, states, there.total, minimum_gain(there.mean_square) * few.samples)


@dataclass(frozen=True)
class Look:
    """A fit to a third of the windows."""

    solution: Solution
    gain: float
    """Loss that the present model has more."""
    trials: float


def look(few: Few, hypothesis: Hypothesis, known: Floats, term: Term) -> Look:
    """A few iterations from one start of a hypothesis with one more term."""
    larger = hypothesis.with_term(term)
    start = larger.bounded(np.concatenate([known, term.start]))
    if len(known) > _MANY:
        solution = _of_last_term(few, larger, start, few.states, _FIRST_LOOK)
    else:
        solution = fit(few.data.segments, larger, start, few.states, _FIRST_LOOK, _PATIENCE).solution
    return Look(solution, few.total - solution.total, term.trials)


def _of_last_term(
    few: Few, hypothesis: Hypothesis, u: Floats, states: Sequence[Floats], iterations: int = ITERATIONS
) -> Solution:
    """A fit of the last term alone, the others held."""
    last = len(hypothesis.terms[-1].coordinates)
    known = u[: len(u) - last]
    alone = hypothesis.held(u, len(hypothesis.terms) - 1)
    found = fit(few.data.segments, alone, u[len(known) :], states, iterations, _PATIENCE).solution
    return replace(found, hypothesis=hypothesis, u=np.concatenate([known, found.u]))


def hopeful(few: Few, seen: Sequence[Look]) -> list[Look]:
    """The looks with any gain, best first; of those that follow the first only what comes close to it."""
    bar = _HOPE * few.needed
    found = sorted((one for one in seen if one.gain > bar), key=lambda one: -one.gain)[:_STARTS]
    return [one for one in found if one.gain >= (1.0 - _CLOSE) * found[0].gain]


def converged(few: Few, found: Sequence[Look]) -> Look:
    """The best of several looks, each carried on until it gains no more."""
    best = found[0]
    for one in found:
        start = one.solution
        solution = fit(few.data.segments, start.hypothesis, start.u, start.states, patience=_PATIENCE).solution
        if few.total - solution.total > best.gain:
            best = Look(solution, few.total - solution.total, one.trials)
    return best


def hopped(few: Few, found: Look) -> Look:
    """The best of several fits of the last term from places near the best so far (basin hopping; Wales and Doye 1997).

    The minima that gain as much as makes no difference are kept as the scatter of that term.
    """
    rng = np.random.default_rng(0)
    best = found.solution
    hypothesis = best.hypothesis
    term = hypothesis.terms[-1]
    last = len(term.coordinates)
    reach = np.zeros(len(best.u))
    reach[-last:] = [_HOP * min(c.upper - c.lower, 1.0) for c in term.coordinates]
    minima = [best]
    for _ in range(_HOPS):
        u = hypothesis.bounded(best.u + reach * rng.standard_normal(len(reach)))
        minima.append(_of_last_term(few, hypothesis, u, best.states))
        best = min(best, minima[-1], key=lambda solution: solution.total)
    apart = np.array([(one.u - best.u)[-last:] for one in minima if one.total < best.total + few.needed])
    term = replace(term, scatter=apart.T @ apart / max(len(apart) - 1, 1))
    hypothesis = replace(hypothesis, terms=(*hypothesis.terms[:-1], term))
    return Look(replace(best, hypothesis=hypothesis), few.total - best.total, found.trials)


def full_fit(data: Data, present: Judged, found: Look) -> tuple[Fit, float]:
    """Fit to all windows from where a look ended, with the number of trials."""
    start = found.solution
    done = fit(data.segments, start.hypothesis, start.u, present.fit.solution.states, patience=_PATIENCE)
    return done, found.trials


def search(
    data: Data,
    present: Judged,
    context: Context,
    slugs: Sequence[str],
    told: Callable[[float, str], None],
    workers: int | None = None,
) -> dict[str, Judged]:
    """Fit every candidate on top of the present model.

    Args:
        data: windows.
        present: the present model.
        context: sizes and residuals of the present model.
        slugs: candidates.
        told: told(share done, candidate), after each.
        workers: threads; by default two, or what the machine has.

    Returns:
        Slug to the judged hypothesis, of those that improve the fit at all.
    """
    hypothesis, known = present.hypothesis, present.fit.solution.u
    total = present.fit.solution.total
    few = few_of(data, present)
    with _Pool(workers, told) as pool:
        terms = pool.run({slug: partial(BUILDERS[slug], context) for slug in slugs}, 0.0, 0.1)
        starts = {
            (slug, k): partial(look, few, hypothesis, known, t) for slug in slugs for k, t in enumerate(terms[slug])
        }
        seen = pool.run(starts, 0.1, 0.4)
        found = {slug: hopeful(few, [seen[slug, k] for k in range(len(terms[slug]))]) for slug in slugs}
        promising = _leading({slug: (of, of[0].gain) for slug, of in found.items() if of}, _SHARE_OF_LOOKS)
        tried = pool.run({slug: partial(converged, few, of) for slug, of in promising.items()}, 0.4, 0.6)
        hopping = _leading({slug: (one, one.gain) for slug, one in tried.items()}, _SHARE_OF_TRIALS)
        rugged = {slug: one for slug, one in hopping.items() if one.solution.hypothesis.terms[-1].is_rugged}
        tried |= pool.run({slug: partial(hopped, few, one) for slug, one in rugged.items()}, 0.6, 0.7)
        left = _leading({slug: (one, one.gain) for slug, one in tried.items()}, _SHARE_OF_TRIALS, _SURE * few.needed)
        fits = pool.run({slug: partial(full_fit, data, present, one) for slug, one in left.items()}, 0.7, 0.9)
        last = _leading({slug: (of, total - of[0].solution.total) for slug, of in fits.items()}, _SHARE_OF_FITS)
        return pool.run({slug: partial(judge, data, *of) for slug, of in last.items()}, 0.9, 1.0)


def _leading(gains: Mapping[str, tuple[T, float]], share: float, least: float = 0.0) -> dict[str, T]:
    """What gains more than a share of the best gain, and than the least; best first, so that no long job comes last."""
    bar = max(share * max((gain for _, gain in gains.values()), default=0.0), least)
    order = sorted(gains, key=lambda slug: -gains[slug][1])
    return {slug: gains[slug][0] for slug in order if gains[slug][1] > bar}


class _Pool:
    """Threads that report progress and are dropped at once on an interrupt."""

    def __init__(self, workers: int | None, told: Callable[[float, str], None]) -> None:
        self._executor = ThreadPoolExecutor(workers or min(4, os.cpu_count() or 1))
        self._told = told

    def __enter__(self) -> _Pool:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)

    def run(self, jobs: Mapping[K, Callable[[], T]], first: float, last: float) -> dict[K, T]:
        """Results of all jobs, in their order; progress goes from `first` to `last`."""
        running = {self._executor.submit(job): slug for slug, job in jobs.items()}
        for number, done in enumerate(as_completed(running)):
            done.result()
            name = running[done]
            slug = name if isinstance(name, str) else name[0]
            self._told(first + (last - first) * (number + 1) / len(running), slug)
        return {slug: future.result() for future, slug in running.items()}
