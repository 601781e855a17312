"""Proposes sets with one more law, fitted closely enough to be compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import grip, late_record, ripple
from hapticd.gap.candidates import HALVINGS, Ascent, candidates, keeps_the_drive, scale_of
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.law_set import LawSet, scored
from hapticd.gap.parallel import parallel_map

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.fit import Fit
    from hapticd.gap.score import Candidate

_FIRST_STEPS = 3
_SHORTLIST = 8
_MOST_FITTED = 4
_ASCENT_STEPS = 10
"""Most steps of an ascent before sets are compared; only the chosen set is fitted to convergence (`finished`)."""
_HALF = 0.5
"""Share of the needed gain that a law must have to be fitted further."""
ROUGH = 0.2
"""Tolerance of fits that are compared, as a share of the gain that a law needs."""
_CLOSER = 0.3
"""First step of the last compass search, relative to the first search."""
_CLOSEST = 0.02
"""The same for the resolution of a DAC: its likelihood has a narrow peak, since each current is a multiple of it."""


def extensions(present: LawSet, slugs: Sequence[str], least: float) -> list[LawSet]:
    """The set with one more law, for each of the laws that gain most; the best on held-out blocks first.

    Args:
        present: the set. slugs: laws that may be added. least: gain that a law needs, nats.
    """
    found = sorted(candidates(present.fit, slugs, least), key=lambda one: -one.expected_gain) if slugs else []

    def approach(candidate: Candidate) -> tuple[Candidate, Fit]:
        fit = present.fit.extended(candidate.term)
        if CATALOGUE[candidate.slug].acts_on == "memory":
            fit.scan_power()  # its term is already maximised
            return candidate, fit
        # All laws are free: for example, a drag gains little with viscous friction fixed.
        return candidate, fit.approach(len(NOISE), _FIRST_STEPS)

    def gain(fit: Fit) -> float:
        return fit.log_likelihood - present.fit.log_likelihood

    # A late record is always proposed, even if laws gain more: they can have the same signature.
    likeliest = list(dict.fromkeys(one.slug for one in found))[:_SHORTLIST]
    listed = [one for one in found if one.slug in likeliest or late_record.is_late(one.term)]
    near = parallel_map(approach, [one for one in listed if one.expected_gain > _HALF * least])
    near = [(one, fit) for one, fit in near if gain(fit) > _HALF * least and keeps_the_drive(fit, present.fit)]
    best_of: dict[str, tuple[Candidate, Fit]] = {}
    for pair in sorted(near, key=lambda pair: -gain(pair[1])):
        best_of.setdefault(pair[0].slug, pair)
    near = list(best_of.values())

    def maximised(pair: tuple[Candidate, Fit], best: float = -np.inf) -> LawSet | None:
        candidate, fit = pair
        fit.maximise(_ASCENT_STEPS, ROUGH * least, best)
        law, own = fit.terms[-1], fit.columns(len(fit.terms) - 1)
        if not keeps_the_drive(fit, present.fit) or law.at_bounds(fit.u[own]):
            return None  # a law at its limit is another law
        return scored(fit, present.penalty + candidate.penalty)

    sets = [maximised(pair) for pair in near[:1]]
    best = near[0][1].log_likelihood if near else -np.inf
    others = [pair for k, pair in enumerate(near) if k > 0 and (k < _MOST_FITTED or late_record.is_late(pair[0].term))]
    sets += parallel_map(lambda pair: maximised(pair, best), others)
    return sorted((one for one in sets if one is not None), key=lambda one: -one.total)


def finished(laws: LawSet) -> LawSet:
    """The set fitted to convergence.

    A grip and the orders of a ripple are searched again, because they were found with other effects still missing. Effects
    with memory were maximised on a subsample, and have a non-smooth likelihood, as has the narrow peak of a DAC's
    resolution: these get a compass search.
    """
    fit, penalty = laws.fit, laws.penalty
    for number, item in enumerate(fit.terms):
        acts_on = CATALOGUE[item.slug].acts_on if item.slug in CATALOGUE else ""
        if item.slug == grip.SLUG:
            fit = grip.maximised(fit, number, scale_of(fit))
        elif item.slug == ripple.SLUG:
            fit, more = ripple.refined(fit, number, scale_of(fit))
            penalty += more
        elif acts_on == "memory":
            Ascent(fit, number, _CLOSER).go(HALVINGS)
        elif acts_on == "input":
            Ascent(fit, number, _CLOSEST).go(2 * HALVINGS)
            fit.in_turn(_ASCENT_STEPS)
    return scored(fit.maximise(), penalty)
