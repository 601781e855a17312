"""The base parameters in the search: freed, compared with the model's values, and named, left free, or dropped."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.gap import constants
from hapticd.gap.base_model import Balanced, base_law
from hapticd.gap.law_set import LawSet, Round, evidence, is_at_noise_level, scored
from hapticd.gap.nominal import likeliest_fit
from hapticd.gap.parallel import parallel_map
from hapticd.gap.sets import likelier
from hapticd.gap.terms import BASE_WORDS, term
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from hapticd.gap.fit import Fit
    from hapticd.gap.inertia_range import InertiaRange
    from hapticd.gap.sets import Sets
    from hapticd.gap.terms import Term

FACTOR: Final = "torque_constant_error"
CORRECTIONS: Final = frozenset((*BASE_WORDS, FACTOR))
"""Errors of the coefficients of eq. 1. A common factor of all four changes nothing, so three of them are enough."""
_INERTIA = "inertia_error"
_KNOWN = 0.01
"""Relative accuracy of any base parameter: a smaller deviation is not named where it hardly changes the missing force."""


class FreeBase:
    """The base parameters of a search.

    Attributes:
        sets: the sets of the search. slugs: base parameters that may be free.
        balance: their values by least squares. is_held: whether the inertia is kept in the range of that balance, because
            the best prediction leaves more force.
    """

    def __init__(self, sets: Sets, slugs: list[str], balance: Balanced) -> None:
        self.sets, self.balance, self.is_held = sets, balance, False
        self.slugs = [slug for slug in BASE_WORDS if slug in slugs]
        self._has_factor = FACTOR in slugs
        self._tried: set[frozenset[str]] = set()

    def first(self) -> LawSet | None:
        """The given model with free base parameters; None where they are not free, or nothing is missing."""
        self._tried.add(frozenset())
        if not self.slugs or is_at_noise_level(self.sets.given.fit):
            return None
        starts = [self._starts({})]
        if self.balance.values:
            starts.append(self._starts(self.balance.values))
        return scored(likeliest_fit(self.sets.problem, starts, self.sets.given.fit.noise))

    def held(self, free: LawSet) -> LawSet:
        """The first set: with the inertia in the range of the balance, if it has left that, and leaves more force.

        The balance assumes a record that is not late. It is not asked where the config has an uncertainty of the inertia.
        """
        given = self.sets.given
        has_prior = any(item.slug == BASE_WORDS[_INERTIA] for item in self.sets.known)
        self.is_held = _INERTIA in self.slugs and not has_prior and self.balance.contradicts(free.fit)
        if not self.is_held:
            return free
        start = self._starts(self.balance.values, self.balance.inertia)
        held = scored(likeliest_fit(self.sets.problem, [start], given.fit.noise))
        is_closer = held.power < constants.CLOSED * given.power
        self.is_held = is_closer or evidence(held, given)[0] >= self.sets.least
        return held if self.is_held else given

    def freed(self, present: LawSet) -> LawSet | None:
        """The set with all base parameters free, if that gains; asked once for each set of other laws."""
        others = frozenset(present.laws).difference(BASE_WORDS)
        if others in self._tried or FACTOR in others or not self.slugs or is_at_noise_level(present.fit):
            return None
        self._tried.add(others)
        fit = present.fit
        for slug in (slug for slug in self.slugs if slug not in present.laws):
            law = self._law(slug, float(fit.device()[index_of(BASE_WORDS[slug])]))
            known = [number for number, item in enumerate(fit.terms) if item.slug == BASE_WORDS[slug]]
            fit = fit.replaced(known[0], law) if known else fit.extended(law)
        free = scored(fit.maximise(), present.penalty)
        return free if self.unsure(present) or evidence(free, present)[0] >= self.sets.least else None

    def at_the_model(self, laws: LawSet) -> LawSet:
        """The set with the model's base parameters, and with the model's noise or its own, whichever is likelier."""
        fit, u = laws.fit, laws.fit.u.copy()
        for number, item in enumerate(fit.terms):
            if item.slug in BASE_WORDS:
                (own,) = item.coordinates
                u[fit.columns(number)] = own.centre
        return LawSet(likelier(fit.at(u), self.sets.given.fit.noise), laws.held_out, laws.penalty)

    def with_late_record(self, fit: Fit) -> None:
        """Restart from the values of a fit with a late record: the balance of forces assumed that it is not late."""
        base = {item.slug: fit.u[fit.columns(k).start] for k, item in enumerate(fit.terms) if item.slug in BASE_WORDS}
        self.balance = Balanced({**self.balance.values, **{slug: math.exp(u) for slug, u in base.items()}})
        self._tried.clear()

    def settled(self, free: LawSet) -> Iterator[Round]:
        """Compare each base parameter with the model's value.

        It keeps its name if it is sure, stays free without one if it gains, and is dropped otherwise. Those that differ by a
        common factor are replaced by the torque constant.
        """
        present = free
        while members := [slug for slug in present.laws if slug in BASE_WORDS and not self.stays(present, slug)]:
            if present is free and not any(self.stays(present, slug) for slug in present.laws):
                bare = present
                for slug in members:
                    bare = self.sets.less(bare, slug)
                bare = scored(likelier(bare.fit, self.sets.given.fit.noise).maximise(), bare.penalty)
                comparison = self.sets.is_better(present, bare)
                if not comparison.is_better and comparison.gain < self.sets.least:
                    yield Round("drop", members[0], bare, present, comparison)
                    return
            reduced = {slug: self.sets.without(present, slug) for slug in members}
            asked = {slug: self.sets.is_better(present, one) for slug, one in reduced.items()}
            small = [slug for slug in members if self._is_small(present.law(slug), reduced[slug])]
            not_sure = [slug for slug in members if not asked[slug].is_better or slug in small]
            if not not_sure:
                break
            least = min(not_sure, key=lambda slug: asked[slug].gain)
            is_unsure = least not in small and asked[least].gain >= self.sets.least
            fewer = self._unnamed(present, least) if is_unsure else reduced[least]
            yield Round("drop", least, fewer, present, asked[least])
            present = fewer
        by_a_factor = self._by_a_factor(present)
        if by_a_factor is not None:
            yield by_a_factor

    def unsure(self, present: LawSet) -> list[str]:
        """Base parameters that are free in a set, but not named: they gain, without sufficient evidence for a name."""
        own = [item.slug for item in present.fit.terms if item not in self.sets.known]
        return [slug for slug, name in BASE_WORDS.items() if name in own]

    def without_unsure(self, present: LawSet) -> LawSet:
        """The set with unsure base parameters at the model's values again."""
        fit = present.fit
        for slug in self.unsure(present):
            fit = self.sets.less(LawSet(fit, present.held_out), BASE_WORDS[slug]).fit
        return scored(likelier(fit, self.sets.given.fit.noise).maximise(), present.penalty)

    def stays(self, laws: LawSet, slug: str) -> bool:
        """Whether an inertia is kept in a range that excludes the model's: it is not tested by likelihood."""
        if not (self.is_held and slug == _INERTIA):
            return False
        (own,) = laws.law(slug).coordinates
        return not own.lower <= own.centre <= own.upper

    def _starts(self, values: Mapping[str, float], inertia: InertiaRange | None = None) -> tuple[Term, ...]:
        """The terms that are known, and free base parameters instead of those among them."""
        names = {BASE_WORDS[slug] for slug in self.slugs}
        others = (item for item in self.sets.known if item.slug not in names)
        return (*others, *(self._law(slug, values.get(slug), inertia) for slug in self.slugs))

    def _law(self, slug: str, value: float | None = None, inertia: InertiaRange | None = None) -> Term:
        """The law of a base parameter, started from a value; an inertia is limited to a range, if there is one."""
        filter_s, balanced = self.sets.given.fit.filter_s(), self.balance.values.get(slug)
        return base_law(self.sets.problem, slug, value, filter_s, balanced, inertia if slug == _INERTIA else None)

    def _is_small(self, law: Term, reduced: LawSet) -> bool:
        """Whether a base parameter equals the model's within `_KNOWN`, and nothing relevant is missing without it."""
        is_near = abs(law.start[0] - law.coordinates[0].centre) < _KNOWN
        return is_near and reduced.power < constants.MATTERS * self.sets.given.power

    @staticmethod
    def _unnamed(present: LawSet, slug: str) -> LawSet:
        return LawSet(present.fit.renamed(slug, BASE_WORDS[slug]), present.held_out, present.penalty)

    def _by_a_factor(self, present: LawSet) -> Round | None:
        """The set with the torque constant instead of base parameters that are wrong by a common factor, if as good."""
        members = [slug for slug in present.laws if slug in BASE_WORDS]
        if self.is_held or len(members) < 2 or not self._has_factor:
            return None
        before = present
        away = [float(one.start[0] - one.coordinates[0].centre) for one in map(present.law, members)]
        factor = math.exp(-float(np.mean(away)))
        kept: list[tuple[str, ...]] = [()]
        if len(members) == 3:
            kept += [(slug,) for slug in members]

        def tried(kept: tuple[str, ...]) -> LawSet:
            fit = present.fit
            for slug in members:
                if slug not in kept:
                    fit = self.sets.less(LawSet(fit, present.held_out), slug).fit
            fit = likelier(fit.extended(term(FACTOR, {"r": factor - 1.0}, (), 1.0)), self.sets.given.fit.noise)
            return scored(fit.maximise(), present.penalty)

        for one in parallel_map(tried, kept):
            if one.total > present.total + self.sets.least:  # the free base parameters contain this case
                present = max(present, self._of_factor(one, present), key=lambda laws: laws.total)
            comparison = self.sets.is_better(one, present)
            if comparison.is_better and self.sets.closes_as_much(one, present):
                return Round("swap", members[0], one, present, comparison)
        return Round("begin", "", present) if present is not before else None

    def _of_factor(self, one: LawSet, present: LawSet) -> LawSet:
        """The set with base parameters started from the values of a set with the torque constant."""
        fit = present.fit.with_noise(one.fit.noise)
        u, factor = fit.u.copy(), 1.0 + float(one.law(FACTOR).start[0])
        for slug in BASE_WORDS:
            if slug in present.laws:
                value = float(one.fit.device()[index_of(BASE_WORDS[slug])]) / factor
                u[fit.columns(present.number(slug))] = math.log(value)
        return scored(fit.at(np.clip(u, fit.lower, fit.upper)).maximise(), present.penalty)
