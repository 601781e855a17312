"""Which sets of laws are worth a question: a set with one law more, maximised close enough to its maximum to be compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import grip, late_record, ripple
from hapticd.gap.candidates import HALVINGS, Ascent, candidates, keeps_the_drive, scale_of
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.law_set import LawSet, scored
from hapticd.gap.parallel import each

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.fit import Fit
    from hapticd.gap.score import Candidate

_FIRST_STEPS = 3
_SHORTLIST = 8
_MOST_FITTED = 4
_CLIMB = 10
"""Steps of an ascent that is to be compared: that of the set which is taken goes to the end."""
_HALF = 0.5
"""Share of what a law must gain which it must have gained to be maximised farther."""
ROUGH = 0.2
"""Share of what a law must gain to which sets are maximised before they are compared."""
_CLOSER = 0.3
"""First steps of the last ascent over those of the first."""
_CLOSEST = 0.02
"""The same where a step of a converter, many times over, makes a current: the likelihood is a spike."""


def extensions(present: LawSet, slugs: Sequence[str], least: float) -> list[LawSet]:
    """The present set with one law more, for each of the laws that gain most; the best on held-out blocks first.

    Args:
        present: the set. slugs: laws that may be added. least: what a law must gain, nats.
    """
    found = sorted(candidates(present.fit, slugs, least), key=lambda one: -one.expected_gain) if slugs else []

    def approach(candidate: Candidate) -> tuple[Candidate, Fit]:
        fit = present.fit.extended(candidate.term)
        if CATALOGUE[candidate.slug].acts_on == "memory":
            fit.scan_power()  # it was maximised as a candidate
            return candidate, fit
        # All laws are fitted along: a drag may gain next to nothing as long as viscous friction stays where it was.
        return candidate, fit.approach(len(NOISE), _FIRST_STEPS)

    def gain(fit: Fit) -> float:
        return fit.log_likelihood - present.fit.log_likelihood

    # A fault of the record is asked about whatever gains more: laws imitate it.
    likeliest = list(dict.fromkeys(one.slug for one in found))[:_SHORTLIST]
    listed = [one for one in found if one.slug in likeliest or late_record.is_late(one.term)]
    near = each(approach, [one for one in listed if one.expected_gain > _HALF * least])
    near = [(one, fit) for one, fit in near if gain(fit) > _HALF * least and keeps_the_drive(fit, present.fit)]
    best_of: dict[str, tuple[Candidate, Fit]] = {}
    for pair in sorted(near, key=lambda pair: -gain(pair[1])):
        best_of.setdefault(pair[0].slug, pair)
    near = list(best_of.values())

    def maximised(pair: tuple[Candidate, Fit], best: float = -np.inf) -> LawSet | None:
        candidate, fit = pair
        fit.maximise(_CLIMB, ROUGH * least, best)
        law, own = fit.terms[-1], fit.columns(len(fit.terms) - 1)
        if not keeps_the_drive(fit, present.fit) or law.at_bounds(fit.u[own]):
            return None  # a law at its limit is another law
        return scored(fit, present.penalty + candidate.penalty)

    sets = [maximised(pair) for pair in near[:1]]
    best = near[0][1].log_likelihood if near else -np.inf
    others = [pair for k, pair in enumerate(near) if k > 0 and (k < _MOST_FITTED or late_record.is_late(pair[0].term))]
    sets += each(lambda pair: maximised(pair, best), others)
    return sorted((one for one in sets if one is not None), key=lambda one: -one.total)


def finished(laws: LawSet) -> LawSet:
    """The set maximised to the end.

    A grip, or orders of a ripple, that were found beside what was still missing are looked for again; the edges of a grip
    once more whenever all else has moved, since an ascent from edges that are off ends beside the maximum. What a device
    remembers was maximised in a part of the record, and fitted by slopes that a rough likelihood does not have; nor has the
    spike of a converter's step, which holds up all others in a common ascent.
    """
    fit, penalty = laws.fit, laws.penalty
    for number, item in enumerate(fit.terms):
        acts_on = CATALOGUE[item.slug].acts_on if item.slug in CATALOGUE else ""
        if item.slug == grip.SLUG:
            fit = grip.maximised(fit, number, scale_of(fit))
        elif item.slug == ripple.SLUG:
            fit, more = ripple.settled(fit, number, scale_of(fit))
            penalty += more
        elif acts_on == "memory":
            Ascent(fit, number, _CLOSER).go(HALVINGS)
        elif acts_on == "input":
            Ascent(fit, number, _CLOSEST).go(2 * HALVINGS)
            fit.in_turn(_CLIMB)
    return scored(fit.maximise(), penalty)
