"""Try every candidate on top of a present model and judge each on held-out data.

Fits run in threads: the kernels release the GIL.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from hapticd.gap.candidates import BUILDERS
from hapticd.gap.crossval import held_out
from hapticd.gap.evidence import MINIMUM_GAIN, Comparison, Scored, compare
from hapticd.gap.fit import fit

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from hapticd.gap.context import Context
    from hapticd.gap.fit import Fit, Solution
    from hapticd.gap.hypothesis import Hypothesis, Term
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]

T = TypeVar("T")

_FIRST_LOOK = 3
"""Iterations that decide which start of a candidate is fitted to the end."""
_CLOSE = 0.2
"""A second start is fitted too if its first look is within this share of the best gain."""
_HOPE = 0.4
"""Share of the smallest gain that counts which a first look must show."""
_SHARE_OF_LOOKS, _SHARE_OF_FITS = 0.08, 0.4
"""Candidates that gain less than this share of the best one's gain cannot win the round, nor tie: not fitted to the end,
and not cross-validated."""
_THIN, _RUN = 3, 4
_PATIENCE = 1e-3


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
        return compare(self.held_out, other.held_out, data.block, data.samples)


def thinned(data: Data, states: Sequence[Floats]) -> tuple[Data, list[Floats]]:
    """A third of the windows, in runs of a few: enough for a first look, and no second of the recording is left out."""
    segments, kept, blocks, offset = [], [], [], 0
    for segment, state in zip(data.segments, states, strict=True):
        block = data.block[offset : offset + segment.count]
        offset += segment.count
        mask = np.arange(segment.count) // _RUN % _THIN == 0
        segments.append(segment.chosen(mask))
        kept.append(state[mask])
        blocks.append(block[mask])
    return Data(segments, np.concatenate(blocks)), kept


def judge(data: Data, fitted: Fit, trials: float = 1.0) -> Judged:
    """Cross-validate a fit."""
    return Judged(fitted, held_out(data.segments, fitted, data.block), trials)


@dataclass(frozen=True)
class Look:
    """A few iterations from one start on a third of the data."""

    solution: Solution
    gain: float
    """Loss that the present model has more."""
    trials: float


def looks(data: Data, present: Judged, hypothesis: Hypothesis, terms: Sequence[Term]) -> list[Look]:
    """Looks at a hypothesis with one more term, from each of several starts, best first; none without any gain."""
    if not terms:
        return []
    few, few_states = thinned(data, present.fit.solution.states)
    known = present.fit.solution.u
    before = fit(few.segments, present.hypothesis, known, few_states, 0).solution.total
    result = []
    for term in terms:
        larger = hypothesis.with_term(term)
        start = larger.bounded(np.concatenate([known[: len(hypothesis.coordinates)], term.start]))
        solution = fit(few.segments, larger, start, few_states, _FIRST_LOOK).solution
        result.append(Look(solution, before - solution.total, term.trials))
    bar = _HOPE * MINIMUM_GAIN * few.samples
    return sorted((look for look in result if look.gain > bar), key=lambda look: -look.gain)


def best_fit(data: Data, present: Judged, found: Sequence[Look]) -> tuple[Fit, float]:
    """Full fit from the best look, and from the second where it is close; with the number of trials."""
    best: Fit | None = None
    for look in found[:2]:
        if best is not None and look.gain < (1.0 - _CLOSE) * found[0].gain:
            break
        solution = look.solution
        done = fit(data.segments, solution.hypothesis, solution.u, present.fit.solution.states, patience=_PATIENCE)
        if best is None or done.solution.total < best.solution.total:
            best = done
    assert best is not None
    return best, found[0].trials


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
    hypothesis = present.hypothesis
    total = present.fit.solution.total
    with _Pool(workers, told) as pool:
        seen = pool.run(
            {slug: partial(_looks_of, data, present, hypothesis, context, slug) for slug in slugs}, 0.0, 0.4
        )
        bar = _SHARE_OF_LOOKS * max((found[0].gain for found in seen.values() if found), default=0.0)
        fits = pool.run(
            {
                slug: partial(best_fit, data, present, found)
                for slug, found in seen.items()
                if found and found[0].gain > bar
            },
            0.4,
            0.8,
        )
        bar = _SHARE_OF_FITS * max((total - fitted.solution.total for fitted, _ in fits.values()), default=0.0)
        return pool.run(
            {
                slug: partial(judge, data, fitted, trials)
                for slug, (fitted, trials) in fits.items()
                if total - fitted.solution.total > bar
            },
            0.8,
            1.0,
        )


def _looks_of(data: Data, present: Judged, hypothesis: Hypothesis, context: Context, slug: str) -> list[Look]:
    return looks(data, present, hypothesis, BUILDERS[slug](context))


class _Pool:
    """Threads that report progress and are dropped at once on an interrupt."""

    def __init__(self, workers: int | None, told: Callable[[float, str], None]) -> None:
        self._executor = ThreadPoolExecutor(workers or min(4, os.cpu_count() or 1))
        self._told = told

    def __enter__(self) -> _Pool:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)

    def run(self, jobs: Mapping[str, Callable[[], T]], first: float, last: float) -> dict[str, T]:
        """Results of all jobs, in their order; progress goes from `first` to `last`."""
        running = {self._executor.submit(job): slug for slug, job in jobs.items()}
        for number, done in enumerate(as_completed(running)):
            done.result()
            self._told(first + (last - first) * (number + 1) / len(running), running[done])
        return {slug: future.result() for future, slug in running.items()}
