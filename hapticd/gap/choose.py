"""Choose a set of laws: add, drop or replace one, as long as the set gets better (`is_better`).

The search starts with the base parameters free, or with the model's values where those are as good. Free base parameters
are judged when no law can be added any more: each one that is still within its prior is dropped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import chance, constants, grip, late_record
from hapticd.gap.base_model import Balanced, base_law
from hapticd.gap.candidates import keeps_the_drive
from hapticd.gap.law_set import Comparison, LawSet, evidence, is_at_noise_level, is_better, scored
from hapticd.gap.lines import line_term
from hapticd.gap.nominal import likeliest_fit, nominal_fit
from hapticd.gap.parallel import parallel_map
from hapticd.gap.propose import ROUGH, extensions, finished
from hapticd.gap.terms import BASE_WORDS, LINE, term
from hapticd.gap.unnamed import with_function
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.inertia_range import InertiaRange
    from hapticd.gap.problem import Problem
    from hapticd.gap.terms import Term

_FACTOR, _INERTIA = "torque_constant_error", "inertia_error"
_CORRECTIONS = frozenset((*BASE_WORDS, _FACTOR))
"""Errors of the coefficients of eq. 1. A common factor of all four changes nothing, so three of them are enough."""
_KNOWN = 0.01
"""Relative accuracy of any base parameter: a smaller deviation is not named where it hardly changes the missing force."""
_MAXIMISED = 2.0 * constants.INDISTINGUISHABLE
"""Standard errors behind the chosen set, up to which a set is maximised before it is compared."""
_FAR_BEHIND = 12.0
"""Standard errors behind another set, from which a set is not tried any more."""


@dataclass(frozen=True)
class Round:
    """One move of the search.

    Attributes:
        move: begin, add, drop or swap. law: the law that is added, dropped or replaced.
        chosen: the set after the move. other: the set it was compared with; None for the first.
        comparison: why. rivals: sets with another law instead, the best first.
        function: coordinate of the unnamed function that replaced the law in a swap; empty for none.
    """

    move: Literal["begin", "add", "drop", "swap"]
    law: str
    chosen: LawSet
    other: LawSet | None = None
    comparison: Comparison | None = None
    rivals: tuple[LawSet, ...] = ()
    function: str = ""


@dataclass(frozen=True)
class Named:
    """A law of the chosen set.

    Attributes:
        law: its slug. comparison: of the sets with and without it.
        ties: sets with another law instead that these data do not distinguish from the chosen set.
        ranked: for each rival: law, gain and standard errors over the set without it, standard errors behind the chosen set.
    """

    law: str
    comparison: Comparison
    ties: tuple[LawSet, ...]
    ranked: tuple[tuple[str, float, float, float], ...]


def needed_errors(blocks: int, tried: int) -> float:
    """Standard errors that a law needs if `tried` laws compete (Bonferroni)."""
    return chance.standard_errors(constants.LEVEL / max(tried, 1), blocks)


def _key(fit: Fit) -> tuple[object, ...]:
    """Identity of a fit's model: its laws, free parameters, and values that are chosen instead of fitted."""
    return tuple(
        sorted((item.slug, tuple((c.name, c.word) for c in item.coordinates), item.fixed) for item in fit.terms)
    )


def _is_near_given(base: Term) -> bool:
    """Whether a base parameter equals the given one within `_KNOWN`."""
    return abs(base.start[0] - base.coordinates[0].centre) < _KNOWN


def _is_near(one: LawSet, best: LawSet) -> bool:
    """Whether a set may still become as good as the best: it has no late record, and is not far behind."""
    return not late_record.is_late(one.fit.terms[-1]) and evidence(best, one)[1] < _FAR_BEHIND


def _least_behind(one: LawSet, chosen: LawSet) -> float:
    """Standard errors that a set is behind another, with a fast or with a slow disturbance: the smaller of the two."""
    behind = -evidence(one, chosen)[1]
    if behind < constants.INDISTINGUISHABLE:
        return behind
    return min(behind, -evidence(one.with_slow_disturbance, chosen.with_slow_disturbance)[1])


class Search:
    """The search for a set of laws.

    Attributes:
        problem: what is fitted. slugs: laws that may be added.
        known: fitted terms that do not count as laws: base parameters with the model's uncertainty as prior, a late record.
        balance: base parameters by least squares. is_held: whether the inertia is kept in the range of that balance,
            because the best prediction leaves more force. is_asked: whether the user named the laws to consider.
    """

    def __init__(
        self,
        problem: Problem,
        slugs: Sequence[str],
        known: Sequence[Term] = (),
        balance: Balanced | None = None,
        *,
        is_asked: bool = False,
    ) -> None:
        self.problem, self.slugs, self.known = problem, tuple(slugs), tuple(known)
        self.balance, self.is_held, self.is_asked = balance or Balanced({}), False, is_asked
        self.needed = needed_errors(problem.series.blocks, len(slugs))
        self.least = 0.5 * self.needed**2
        self._tried_free: set[frozenset[str]] = set()
        self._seen: set[frozenset[str]] = set()
        self._rivals: dict[str, set[str]] = {}
        self._noise: dict[str, Floats] = {}
        self._others: dict[tuple[str, frozenset[str]], list[LawSet]] = {}
        self._likeliest: dict[tuple[object, ...], LawSet] = {}

    @cached_property
    def given(self) -> LawSet:
        """The given model, with spectral lines where their evidence is sufficient."""
        plain = scored(nominal_fit(self.problem, self.known))
        line = None if any(item.slug == LINE for item in self.known) else line_term(plain.fit)
        if line is None:
            return plain
        with_lines = scored(plain.fit.extended(line).maximise())
        if evidence(with_lines, plain)[1] < self.needed:
            return plain
        self.known = (*self.known, with_lines.fit.terms[-1].moved(with_lines.fit.u[-len(line.start) :]))
        return with_lines

    def rounds(self) -> Iterator[Round]:
        """The moves, one by one; the set of the last one is the result."""
        present = self.given
        for move in self._moves():
            yield move
            present = move.chosen
        if not self.is_asked:
            yield from self._unnamed(present)

    def _moves(self) -> Iterator[Round]:
        present, is_free = self._first()
        yield Round("begin", "", present)
        while True:
            freed = None if is_free else self._freed(present)
            if freed is not None:
                present, is_free = freed, True
                yield Round("begin", "", present)
            added = self._added(present, is_free=is_free)
            if added is not None:
                if late_record.is_late(added.chosen.fit.terms[-1]):
                    self._take_late(added.chosen.fit)
                    present, is_free = self._first()
                    yield Round("begin", late_record.SLUG, present)
                    continue
                yield added
                present = added.chosen
                for change in self._revised(present, 1, is_free=is_free):
                    yield change
                    present = change.chosen
                if frozenset(present.laws) not in self._seen:
                    self._seen.add(frozenset(present.laws))
                    continue
            if not is_free:
                return
            is_free, before = False, present
            self._seen.clear()
            for change in self._in_prior(present):
                yield change
                present = change.chosen
            for change in self._revised(present, 0, is_free=False):
                yield change
                present = change.chosen
            if evidence(before, present)[0] < self.least:
                return  # the dropped laws explained nothing, so no new law can be needed

    def settled(self, chosen: LawSet) -> LawSet:
        """The set without the base parameters that are within their prior."""
        for change in self._in_prior(chosen):
            chosen = change.chosen
        return chosen

    def named(self, chosen: LawSet) -> list[Named]:
        """The laws of a set, by descending gain, each with the sets that these data do not distinguish from it."""
        found = []
        for slug in chosen.laws:
            reduced = self.without(chosen, slug)
            rivals = self._in_place(chosen, reduced, slug)
            near = [
                one for one in rivals if self._closes_as_much(one, chosen) and _least_behind(one, chosen) < _MAXIMISED
            ]
            maximised = {id(one): finished(one) for one in near}
            rivals = sorted((maximised.get(id(one), one) for one in rivals), key=lambda one: -one.total)
            ties = [one for one in rivals if self._is_tied(one, chosen, reduced)]
            ranked = [(one.laws[-1], *evidence(one, reduced), max(evidence(chosen, one)[1], 0.0)) for one in rivals]
            found.append(Named(slug, is_better(chosen, reduced, self.needed), tuple(ties), tuple(ranked)))
        return sorted(found, key=lambda one: -one.comparison.gain)

    def _is_tied(self, one: LawSet, chosen: LawSet, reduced: LawSet) -> bool:
        """Whether a set with another law is tied: better than the set with neither law, and near the chosen set."""
        law = next(slug for slug in chosen.laws if slug not in reduced.laws)
        is_worse = evidence(one, chosen)[0] < -self.least
        is_beaten = is_worse and is_at_noise_level(chosen.fit) and not is_at_noise_level(one.fit)
        is_limit = law in CATALOGUE[one.laws[-1]].contains and chosen.numbers < one.numbers
        if is_limit or is_beaten or not self._closes_as_much(one, chosen):
            return False  # a law is never worse than its own limit
        is_near = _least_behind(one, chosen) < constants.INDISTINGUISHABLE
        return is_near and is_better(one, reduced, self.needed).is_better

    def _closes_as_much(self, one: LawSet, other: LawSet) -> bool:
        """Whether one set leaves as little missing force as another, up to a negligible share."""
        return one.power < other.power + constants.SHARE * self.given.power

    def _first(self) -> tuple[LawSet, bool]:
        """The first set, and whether its base parameters are free."""
        base = self._base
        self._tried_free.add(frozenset())
        if not base or is_at_noise_level(self.given.fit):
            return self.given, False
        said = self.balance.values

        def start(values: Mapping[str, float], inertia: InertiaRange | None = None) -> tuple[Term, ...]:
            names = {BASE_WORDS[slug] for slug in base}
            others = (item for item in self.known if item.slug not in names)
            return (*others, *(self._base_law(slug, values.get(slug), inertia) for slug in base))

        noise = self.given.fit.noise
        free = scored(likeliest_fit(self.problem, [start({}), start(said)] if said else [start({})], noise))
        # A late record has the same signature as wrong base parameters: it is also tried with the given ones.
        slugs = [slug for slug in self._admissible(self.given) if slug in late_record.OPPOSITES]
        late = [one for one in extensions(self.given, slugs, self.least) if late_record.is_late(one.fit.terms[-1])]
        for one in sorted([free, *late], key=lambda one: -one.total):
            if one is free and evidence(one, self.given)[0] >= self.least:
                break  # evidence and missing force are judged later, with laws in the set
            if one is not free and is_better(one, self.given, self.needed).is_better:
                self._take_late(one.fit)
                return self._first()
        else:
            free = self.given
        self.is_held = self.balance.contradicts(free.fit) and _INERTIA in base
        if self.is_held:  # the balance assumes a record that is not late
            held = scored(likeliest_fit(self.problem, [start(said, self.balance.inertia)], noise))
            less = held.power < constants.CLOSED * self.given.power
            self.is_held = less or evidence(held, self.given)[0] >= self.least
            free = held if self.is_held else self.given
        return free, free is not self.given

    @property
    def _base(self) -> list[str]:
        """Base parameters that may be free."""
        return [slug for slug in BASE_WORDS if slug in self.slugs]

    def _base_law(self, slug: str, value: float | None = None, inertia: InertiaRange | None = None) -> Term:
        """The law of a base parameter, started from a value; an inertia is limited to a range, if there is one."""
        held = inertia if slug == _INERTIA else None
        filter_s, said = self.given.fit.filter_s(), self.balance.values.get(slug)
        return base_law(self.problem, slug, value, filter_s, said, held)

    def _with_base(self, present: LawSet) -> LawSet:
        """The set with all base parameters free, started from their values in it."""
        fit = present.fit
        for slug in (slug for slug in self._base if slug not in present.laws):
            law = self._base_law(slug, float(fit.device()[index_of(BASE_WORDS[slug])]))
            known = [number for number, item in enumerate(fit.terms) if item.slug == BASE_WORDS[slug]]
            fit = fit.replaced(known[0], law) if known else fit.extended(law)
        return scored(fit.maximise(), present.penalty)

    def _freed(self, present: LawSet) -> LawSet | None:
        """The set with all base parameters free, if that gains; asked once for each set of other laws."""
        others = frozenset(present.laws).difference(BASE_WORDS)
        if others in self._tried_free or _FACTOR in others or not self._base or is_at_noise_level(present.fit):
            return None
        self._tried_free.add(others)
        freed = self._with_base(present)
        return freed if self.unsure(present) or evidence(freed, present)[0] >= self.least else None

    def _take_late(self, fit: Fit) -> None:
        """Include a late record in every further fit, and restart the search."""
        number = len(fit.terms) - 1
        law = fit.terms[number].moved(fit.u[fit.columns(number)])
        self.slugs = tuple(late_record.identifiable(self.slugs, law))
        # The balance of forces assumed a record that is not late: its values are replaced by the fitted ones.
        base = {item.slug: fit.u[fit.columns(k).start] for k, item in enumerate(fit.terms) if item.slug in BASE_WORDS}
        self.balance = Balanced({**self.balance.values, **{slug: math.exp(u) for slug, u in base.items()}})
        self.known = (*self.known, late_record.record_term(law))
        self._seen.clear()
        self._tried_free.clear()
        self._others.clear()
        self._likeliest.clear()
        del self.given

    def _admissible(self, present: LawSet) -> list[str]:
        """Laws that may be added to a set: not in it, not equivalent to one in it, not excluded by one."""
        laws = {*present.laws, *self.unsure(present)}
        laws |= {
            other for slug in present.laws for other in (*CATALOGUE[slug].equivalent_to, *CATALOGUE[slug].excludes)
        }
        if len(_CORRECTIONS & laws) > 2:
            laws |= _CORRECTIONS
        return [slug for slug in self.slugs if slug not in laws]

    def _added(self, present: LawSet, *, is_free: bool) -> Round | None:
        """The best set with one more law, if it is better."""
        others = [slug for slug in present.laws if not (is_free and slug in BASE_WORDS)]
        if len(others) >= constants.MOST_EFFECTS or is_at_noise_level(present.fit):
            return None
        slugs = self._admissible(present)
        if is_free:
            slugs = [slug for slug in slugs if slug not in _CORRECTIONS]
        sets = extensions(present, slugs, self.least)
        if (
            not self.is_asked
        ):  # a grip has six numbers: it is asked about where nothing simpler explains what is missing
            sets.sort(key=lambda one: one.laws[-1] == grip.SLUG)

        best = next((one for one in sets if is_better(one, present, self.needed).is_better), None)
        best = best or next((one for one in sets if self._is_fault(one, present)), None)
        if best is None:
            return None
        for other in sets:
            is_limit = other.laws[-1] in CATALOGUE[best.laws[-1]].contains
            if is_limit and is_better(other, best, 0.0).is_better and is_better(other, present, self.needed).is_better:
                best = other
                break
        if late_record.is_late(best.fit.terms[-1]):
            return Round("add", late_record.SLUG, best, present)
        law, rivals = best.laws[-1], [one for one in sets if one is not best and _is_near(one, best)]
        self._rivals[law] = {one.laws[-1] for one in rivals}
        top = finished(best)
        if is_free and CATALOGUE[law].acts_on == "memory":
            # Without the law the base parameters compensated it; a non-smooth likelihood would keep them there.
            top = max(top, finished(self._from_the_model(best)), key=lambda one: one.total)
        comparison = is_better(top, present, self.needed)
        if not (comparison.is_better and keeps_the_drive(top.fit, present.fit)):
            return None
        self._others[law, frozenset(present.laws)] = rivals
        self._noise[law] = present.fit.noise
        return Round("add", law, top, present, comparison, tuple(rivals))

    def _from_the_model(self, laws: LawSet) -> LawSet:
        """The set with the model's base parameters, and with the model's noise or its own, whichever is likelier."""
        fit, u = laws.fit, laws.fit.u.copy()
        for number, item in enumerate(fit.terms):
            if item.slug in BASE_WORDS:
                (own,) = item.coordinates
                u[fit.columns(number)] = own.centre
        return LawSet(self._likelier(fit.at(u), self.given.fit.noise), laws.held_out, laws.penalty)

    def _is_fault(self, one: LawSet, present: LawSet) -> bool:
        """Whether a set adds a late record that closes twice the share that a law must, whatever its evidence."""
        gain, left = evidence(one, present)[0], one.power / present.power
        return late_record.is_late(one.fit.terms[-1]) and gain >= self.least and left < 1.0 - 2.0 * constants.SHARE

    def _revised(self, present: LawSet, newest: int, *, is_free: bool) -> Iterator[Round]:
        """Drop laws that are no longer needed, and swap laws for better ones, except the `newest` ones, just tested."""
        number = len(present.laws) - 1 - newest
        while number >= 0:
            law = present.laws[number]
            if (is_free and law in BASE_WORDS) or self._stays(present, law):
                number -= 1
                continue
            reduced = self.without(present, law)
            comparison = is_better(present, reduced, self.needed)
            if not comparison.is_better:
                yield Round("drop", law, reduced, present, comparison)
                present, number = reduced, len(reduced.laws) - 2
                continue
            swapped = self._swapped(present, reduced, law)
            if swapped is not None:
                yield swapped
                present, number = swapped.chosen, len(swapped.chosen.laws) - 2
                continue
            number -= 1

    def _swapped(self, present: LawSet, reduced: LawSet, law: str) -> Round | None:
        """The set with one law replaced by another, if that is better."""
        for other in self._in_place(present, reduced, law):
            if frozenset(other.laws) in self._seen or not is_better(other, present, self.needed).is_better:
                continue
            top = finished(other)
            comparison = is_better(top, present, self.needed)
            is_closer = self._closes_as_much(top, present) and keeps_the_drive(top.fit, present.fit)
            if comparison.is_better and is_closer and is_better(top, reduced, self.needed).is_better:
                self._rivals.setdefault(top.laws[-1], set()).add(law)
                self._noise[top.laws[-1]] = reduced.fit.noise
                self._seen.add(frozenset(top.laws))
                return Round("swap", law, top, present, comparison)
        return None

    def _unnamed(self, present: LawSet) -> Iterator[Round]:
        """Drop each law that an unnamed function of one coordinate replaces better and with less missing force.

        The comparison is with a slow disturbance: otherwise a function of time could model the disturbance.
        """
        for law in reversed([slug for slug in present.laws if slug not in BASE_WORDS]):
            if is_at_noise_level(present.fit):
                return
            reduced = self.without(present, law)
            other = with_function(reduced.with_slow_disturbance, ROUGH * self.least)
            comparison = is_better(other, present.with_slow_disturbance, self.needed) if other else None
            if other and comparison and comparison.is_better and comparison.left < 1.0:
                yield Round("swap", law, reduced, present, comparison, function=other.function)
                present = reduced

    def _in_place(self, present: LawSet, reduced: LawSet, law: str) -> list[LawSet]:
        """Sets with one law replaced by another: by its limits, and by laws that competed with it."""
        key = law, frozenset(reduced.laws)
        if key not in self._others:
            others = self._rivals.get(law, set()) | set(CATALOGUE[law].contains)
            if law in _CORRECTIONS:
                others |= {*_CORRECTIONS, *CATALOGUE[law].near}
            if len(_CORRECTIONS.intersection(reduced.laws)) > 1:
                others -= _CORRECTIONS
            asked = [slug for slug in self._admissible(reduced) if slug in others - {law}]
            sets = extensions(reduced, asked, self.least) if asked else []
            self._others[key] = [one for one in sets if not late_record.is_late(one.fit.terms[-1])]
        return [one for one in self._others[key] if one.laws[-1] not in present.laws]

    def _in_prior(self, free: LawSet) -> Iterator[Round]:
        """Drop base parameters within their prior; replace those that differ by a common factor by the torque constant."""
        present = free
        while members := [slug for slug in present.laws if slug in BASE_WORDS and not self._stays(present, slug)]:
            if present is free and not any(self._stays(present, slug) for slug in present.laws):
                bare = present
                for slug in members:
                    bare = self._less(bare, slug)
                bare = scored(self._likelier(bare.fit, self.given.fit.noise).maximise(), bare.penalty)
                comparison = is_better(present, bare, self.needed)
                if not comparison.is_better and comparison.gain < self.least:
                    yield Round("drop", members[0], bare, present, comparison)
                    return
            reduced = [self.without(present, slug) for slug in members]
            asked = [is_better(present, one, self.needed) for one in reduced]
            least = constants.MATTERS * self.given.power
            is_small = [
                reduced[k].power < least and _is_near_given(present.law(slug)) for k, slug in enumerate(members)
            ]
            dropped = [k for k, one in enumerate(asked) if not one.is_better or is_small[k]]
            if not dropped:
                break
            k = min(dropped, key=lambda k: asked[k].gain)
            fewer = reduced[k] if asked[k].gain < self.least else self._as_unsure(present, members[k])
            yield Round("drop", members[k], fewer, present, asked[k])
            present = fewer
        by_a_factor = self._by_a_factor(present)
        if by_a_factor is not None:
            yield by_a_factor

    def unsure(self, present: LawSet) -> list[str]:
        """Base parameters that are free in a set, but not named: they gain, without sufficient evidence for a name."""
        own = [item.slug for item in present.fit.terms if item not in self.known]
        return [slug for slug, name in BASE_WORDS.items() if name in own]

    def _as_unsure(self, present: LawSet, slug: str) -> LawSet:
        """The set with a base parameter that is free, but not named."""
        return LawSet(present.fit.renamed(slug, BASE_WORDS[slug]), present.held_out, present.penalty)

    def _by_a_factor(self, present: LawSet) -> Round | None:
        """The set with the torque constant instead of base parameters that are wrong by a common factor, if as good."""
        members = [slug for slug in present.laws if slug in BASE_WORDS]
        if self.is_held or len(members) < 2 or _FACTOR not in self.slugs:
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
                    fit = self._less(LawSet(fit, present.held_out), slug).fit
            fit = self._likelier(fit.extended(term(_FACTOR, {"r": factor - 1.0}, (), 1.0)), self.given.fit.noise)
            return scored(fit.maximise(), present.penalty)

        for one in parallel_map(tried, kept):
            if (
                one.total > present.total + self.least
            ):  # the free base parameters contain this case: restart them from it
                present = max(present, self._of_factor(one, present), key=lambda laws: laws.total)
            comparison = is_better(one, present, self.needed)
            if comparison.is_better and self._closes_as_much(one, present):
                return Round("swap", members[0], one, present, comparison)
        return Round("begin", "", present) if present is not before else None

    def _of_factor(self, one: LawSet, present: LawSet) -> LawSet:
        """The set with base parameters started from the values of a set with the torque constant."""
        fit = present.fit.with_noise(one.fit.noise)
        u, factor = fit.u.copy(), 1.0 + float(one.law(_FACTOR).start[0])
        for slug in BASE_WORDS:
            if slug in present.laws:
                value = float(one.fit.device()[index_of(BASE_WORDS[slug])]) / factor
                u[fit.columns(present.number(slug))] = math.log(value)
        return scored(fit.at(np.clip(u, fit.lower, fit.upper)).maximise(), present.penalty)

    def _stays(self, laws: LawSet, slug: str) -> bool:
        """Whether an inertia is kept in a range that excludes the model's: it is not tested by likelihood."""
        if not (self.is_held and slug == _INERTIA):
            return False
        (own,) = laws.law(slug).coordinates
        return not own.lower <= own.centre <= own.upper

    def _less(self, laws: LawSet, slug: str) -> LawSet:
        """The set without a law, at the same coordinates; a base parameter keeps the prior of the model, if there is one."""
        number = laws.number(slug)
        known = [item for item in self.known if item.slug == BASE_WORDS.get(slug)]
        fit = laws.fit.replaced(number, known[0]) if known else laws.fit.without(number)
        return LawSet(fit, laws.held_out, laws.penalty)

    def without(self, laws: LawSet, slug: str) -> LawSet:
        """The set without a law, maximised from its noise or the noise before that law was added, whichever is likelier."""
        fit = self._less(laws, slug).fit
        fit = self._likelier(fit, self._noise.get(slug, self.given.fit.noise))
        known = self._likeliest.get(_key(fit))
        if known is None or fit.log_likelihood > known.fit.log_likelihood + ROUGH * self.least:
            known = scored(fit.maximise(tolerance=ROUGH * self.least), laws.penalty)
            self._likeliest[_key(fit)] = known
        if laws.penalty == known.penalty:
            return known
        more = (laws.penalty - known.penalty) / known.held_out.size
        return replace(known, held_out=known.held_out - more, penalty=laws.penalty)

    @staticmethod
    def _likelier(fit: Fit, noise: Floats) -> Fit:
        """The fit with its own noise or another, whichever is likelier: with too little noise no ascent converges."""
        return max(fit, fit.with_noise(noise), key=lambda one: one.log_likelihood)
