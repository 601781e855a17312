"""Look back at effects that were added early: is each still needed, and would another do better in its place?

An effect that was first may have stood in for two that came later, or for one that only shows once the others are in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import ties
from hapticd.gap.context import Context
from hapticd.gap.fit import fit
from hapticd.gap.search import Data, Judged, judge, search

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.gap.hypothesis import Hypothesis

_BETTER = 10.0
"""Held-out loss that an effect must save to take another one's place."""


@dataclass(frozen=True)
class Round:
    """One effect, and the candidates it won against."""

    winner: str
    before: Judged
    """Without it."""
    after: Judged
    judged: dict[str, Judged]
    """All candidates, each on top of `before`."""


def without(data: Data, present: Judged, term: int) -> Judged:
    """The present model without one of its effects, fitted anew."""
    hypothesis, solution = present.hypothesis, present.fit.solution
    first = _first_coordinate(hypothesis, term)
    u = np.delete(solution.u, np.s_[first : first + len(hypothesis.terms[term].coordinates)])
    return judge(data, fit(data.segments, hypothesis.without(term), u, solution.states))


def prefix(data: Data, final: Judged, terms: int) -> Judged:
    """The first effects of a model, fitted anew."""
    hypothesis, solution = final.hypothesis, final.fit.solution
    for number in range(len(hypothesis.terms) - 1, terms - 1, -1):
        hypothesis = hypothesis.without(number)
    return judge(data, fit(data.segments, hypothesis, solution.u[: len(hypothesis.coordinates)], solution.states))


def _gain(present: Judged, other: Judged) -> float:
    """Held-out loss that another model saves."""
    return float(present.held_out.loss.sum() - other.held_out.loss.sum())


def _first_coordinate(hypothesis: Hypothesis, term: int) -> int:
    return sum(len(other.coordinates) for other in hypothesis.terms[:term])


def dropped(data: Data, present: Judged, rounds: Sequence[Round], fixed: int) -> tuple[Judged, list[Round]]:
    """Drop every effect but the last that the model does as well without.

    Args:
        data: windows.
        present: the present model, `fixed` terms of the base model first.
        rounds: how its effects were found, in the order of its terms.
        fixed: number of terms that stay.
    """
    kept = list(rounds)
    number = 0
    while number < len(kept) - 1:
        less = without(data, present, fixed + number)
        if present.against(less, data).significant(1.0):
            number += 1
        else:
            present = less
            del kept[number]
    return present, kept


def replaced(
    data: Data,
    present: Judged,
    rounds: Sequence[Round],
    fixed: int,
    told: Callable[[float, str], None],
    workers: int | None = None,
) -> tuple[Judged, list[Round], bool]:
    """Let every effect but the last compete again, in its place in the whole model, with the rivals that it had.

    It competes in a new form too: which orders a ripple has, or which commands were lost, looks different with the later
    effects in place.

    Returns:
        The model, how its effects stand against their rivals, and whether one of them was replaced.
    """
    kept = list(rounds)
    for number in range(len(kept) - 1):
        found = kept[number]
        less = without(data, present, fixed + number)
        used = {slug for other in kept for slug in (other.winner, *ties.exact_class(other.winner))} - {found.winner}
        slugs = [slug for slug in found.judged if slug not in used]
        context = Context(data.segments, less.fit, less.hypothesis.device(less.fit.solution.u, 0).vector)

        def report(share: float, slug: str, done: int = number) -> None:
            told((done + share) / (len(kept) - 1), slug)

        judged = search(data, less, context, slugs, report, workers)
        again = judged.get(found.winner)
        if again is None or _gain(present, again) < _BETTER:
            judged[found.winner] = present
        best = ties.first(judged, judged, data)
        if judged[best] is present or _gain(present, judged[best]) < _BETTER:
            kept[number] = Round(found.winner, less, present, {**judged, found.winner: present})
            continue
        order = kept[:number] + kept[number + 1 :]
        return judged[best], [*order, Round(best, less, judged[best], judged)], True
    return present, kept, False
