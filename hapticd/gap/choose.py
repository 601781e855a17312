"""Choose a set of laws: add one, drop one, put one in another's place, as long as the set gets better (`is_better`).

The search begins with the base parameters fitted along, or as the model has them where that is no worse. Where they are
fitted along they are laws like the others once no law is left to add: what has not left its prior is dropped.
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
from hapticd.gap.law_set import Comparison, LawSet, evidence, is_better, is_quiet, scored
from hapticd.gap.lines import along
from hapticd.gap.nominal import likeliest_fit, nominal_fit
from hapticd.gap.parallel import each
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
"""Errors of the numbers of eq. 1: all four by one factor are none, so that any three say what any others do."""
_KNOWN = 0.01
"""Share of a base parameter by which nobody knows it better: less is no error, where what it leaves matters little."""
_FAR_BEHIND = 12.0
"""Standard errors behind another set beyond which none catches up as more is known."""


@dataclass(frozen=True)
class Round:
    """One move.

    Attributes:
        move: what was done. law: with which law.
        chosen: the set afterwards. other: that with which it was compared; None of the first.
        comparison: why. rivals: sets with another law instead, the best first.
        function: coordinate of the unnamed function that took the law's place in a swap; empty for none.
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
        law: its slug. comparison: of the set with the set without it.
        ties: sets with another law in its place that these data do not distinguish from the chosen set.
        ranked: law, gain and standard errors over the set without it, and standard errors behind the chosen set, of each.
    """

    law: str
    comparison: Comparison
    ties: tuple[LawSet, ...]
    ranked: tuple[tuple[str, float, float, float], ...]


def needed_errors(blocks: int, tried: int) -> float:
    """Standard errors that a law needs when `tried` of them compete."""
    return chance.standard_errors(constants.LEVEL / max(tried, 1), blocks)


def _key(fit: Fit) -> tuple[object, ...]:
    """What is the same of two fits of one set of laws: words, and numbers that are chosen and not fitted."""
    return tuple(
        sorted((item.slug, tuple((c.name, c.word) for c in item.coordinates), item.fixed) for item in fit.terms)
    )


def _is_near_given(base: Term) -> bool:
    """Whether a base parameter is the given one, as well as anybody knows it."""
    return abs(base.start[0] - base.coordinates[0].centre) < _KNOWN


def _is_near(one: LawSet, best: LawSet) -> bool:
    """Whether a set may yet turn out to be as good as the best: no late record, and not far behind."""
    return not late_record.is_late(one.fit.terms[-1]) and evidence(best, one)[1] < _FAR_BEHIND


class Search:
    """What the rounds of one search have in common.

    Attributes:
        problem: what is fitted. slugs: laws that may be added.
        known: terms that are fitted along and are no laws: base parameters within what the model says, a late record.
        balance: what least squares say of the base parameters. is_held: whether the inertia stays where they have it, as
            what predicts best leaves more force. is_asked: whether the laws were asked for by name.
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
        self._was_free = False
        self._seen: set[frozenset[str]] = set()
        self._rivals: dict[str, set[str]] = {}
        self._noise: dict[str, Floats] = {}
        self._others: dict[tuple[str, frozenset[str]], list[LawSet]] = {}
        self._likeliest: dict[tuple[object, ...], LawSet] = {}

    @cached_property
    def given(self) -> LawSet:
        """The model as it is given, with the lines that it leaves where these are sure."""
        plain = scored(nominal_fit(self.problem, self.known))
        line = None if any(item.slug == LINE for item in self.known) else along(plain.fit)
        if line is None:
            return plain
        with_lines = scored(plain.fit.extended(line).maximise())
        if evidence(with_lines, plain)[1] < self.needed:
            return plain
        self.known = (*self.known, with_lines.fit.terms[-1].moved(with_lines.fit.u[-len(line.start) :]))
        return with_lines

    def rounds(self) -> Iterator[Round]:
        """The moves, one by one; the last one's set is the choice."""
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
            added = self._added(present, is_free=is_free)
            if added is not None:
                if late_record.is_late(added.chosen.fit.terms[-1]):
                    self._take_late(added.chosen.fit)
                    present, is_free = self._first()
                    yield Round("begin", late_record.SLUG, present)
                    continue
                if added.law in _CORRECTIONS and not (is_free or self._was_free):
                    # One number that is wrong, or all by a factor, is asked beside each by itself.
                    self._was_free, freed = True, self._with_base(present)
                    if is_better(freed, added.chosen, self.needed).is_better:
                        present, is_free = freed, True
                        yield Round("begin", "", present)
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
            is_free, before, self._was_free = False, present, True
            self._seen.clear()
            for change in self._in_prior(present):
                yield change
                present = change.chosen
            for change in self._revised(present, 0, is_free=False):
                yield change
                present = change.chosen
            if evidence(before, present)[0] < self.least:
                return  # what no longer is in the set explained no law that might be added now

    def settled(self, chosen: LawSet) -> LawSet:
        """The set without the base parameters that have not left their prior."""
        for change in self._in_prior(chosen):
            chosen = change.chosen
        return chosen

    def named(self, chosen: LawSet) -> list[Named]:
        """The laws of a set, the one that gains most first, and which sets cannot be distinguished from it."""
        found = []
        for slug in chosen.laws:
            poorer = self.without(chosen, slug)
            rivals = self._in_place(chosen, poorer, slug)
            far = -2.0 * constants.INDISTINGUISHABLE
            near = [one for one in rivals if evidence(one, chosen)[1] > far and self._closes_as_much(one, chosen)]
            maximised = {id(one): finished(one) for one in near}
            rivals = sorted((maximised.get(id(one), one) for one in rivals), key=lambda one: -one.total)
            ties = [one for one in rivals if self._is_tied(one, chosen, poorer)]
            ranked = [(one.laws[-1], *evidence(one, poorer), max(evidence(chosen, one)[1], 0.0)) for one in rivals]
            found.append(Named(slug, is_better(chosen, poorer, self.needed), tuple(ties), tuple(ranked)))
        return sorted(found, key=lambda one: -one.comparison.gain)

    def _is_tied(self, one: LawSet, chosen: LawSet, poorer: LawSet) -> bool:
        """Whether a set with another law may be right instead: better than the one with neither, and near the chosen."""
        law = next(slug for slug in chosen.laws if slug not in poorer.laws)
        gain, errors = evidence(one, chosen)
        is_beaten = gain < -self.least and is_quiet(chosen.fit) and not is_quiet(one.fit)
        is_limit = law in CATALOGUE[one.laws[-1]].contains and chosen.numbers < one.numbers
        if is_limit or is_beaten or errors < -constants.INDISTINGUISHABLE:
            return False  # what a law is a limit of is always as good
        return self._closes_as_much(one, chosen) and is_better(one, poorer, self.needed).is_better

    def _closes_as_much(self, one: LawSet, other: LawSet) -> bool:
        """Whether as little force is missing with one set as with another, but for a share that does not matter."""
        return one.power < other.power + constants.SHARE * self.given.power

    def _first(self) -> tuple[LawSet, bool]:
        """The set to begin with, and whether the base is fitted along in it."""
        base = self._base
        if not base or is_quiet(self.given.fit):
            return self.given, False
        said = self.balance.values

        def start(values: Mapping[str, float], inertia: InertiaRange | None = None) -> tuple[Term, ...]:
            names = {BASE_WORDS[slug] for slug in base}
            others = (item for item in self.known if item.slug not in names)
            return (*others, *(self._base_law(slug, values.get(slug), inertia) for slug in base))

        noise = self.given.fit.noise
        free = scored(likeliest_fit(self.problem, [start({}), start(said)] if said else [start({})], noise))
        # A late record looks like another base: it is asked beside the given one too.
        slugs = [slug for slug in self._askable(self.given) if slug in late_record.OPPOSITES]
        late = [one for one in extensions(self.given, slugs, self.least) if late_record.is_late(one.fit.terms[-1])]
        for one in sorted([free, *late], key=lambda one: -one.total):
            if one is free and evidence(one, self.given)[0] >= self.least:
                break  # how sure that is, and how much force is missing, is asked when laws are known
            if one is not free and is_better(one, self.given, self.needed).is_better:
                self._take_late(one.fit)
                return self._first()
        else:
            free = self.given
        self.is_held = self.balance.contradicts(free.fit) and _INERTIA in base
        if self.is_held:  # by a balance of a record that is not late
            held = scored(likeliest_fit(self.problem, [start(said, self.balance.inertia)], noise))
            less = held.power < constants.CLOSED * self.given.power
            self.is_held = less or evidence(held, self.given)[0] >= self.least
            free = held if self.is_held else self.given
        return free, free is not self.given

    @property
    def _base(self) -> list[str]:
        """Base parameters that may be fitted along."""
        return [slug for slug in BASE_WORDS if slug in self.slugs]

    def _base_law(self, slug: str, value: float | None = None, inertia: InertiaRange | None = None) -> Term:
        """The law of a base parameter, from a value; an inertia in a range, if there is one."""
        held = inertia if slug == _INERTIA else None
        filter_s, said = self.given.fit.filter_s(), self.balance.values.get(slug)
        return base_law(self.problem, slug, value, filter_s, said, held)

    def _with_base(self, present: LawSet) -> LawSet:
        """The set with all base parameters fitted along, from where they are."""
        fit = present.fit
        for slug in (slug for slug in self._base if slug not in present.laws):
            law = self._base_law(slug, float(fit.device()[index_of(BASE_WORDS[slug])]))
            known = [number for number, item in enumerate(fit.terms) if item.slug == BASE_WORDS[slug]]
            fit = fit.replaced(known[0], law) if known else fit.extended(law)
        return scored(fit.maximise(), present.penalty)

    def _is_not_base(self, one: LawSet, poorer: LawSet) -> bool:
        """Whether the newest law gains beside base parameters that are fitted along: their small errors look like it."""
        law = one.laws[-1]
        alike = {law, *CATALOGUE[law].near}
        if law in _CORRECTIONS or alike.isdisjoint(
            other for slug in self._base for other in (slug, *CATALOGUE[slug].near)
        ):
            return True
        return is_better(self._with_base(one), self._with_base(poorer), self.needed).is_better

    def _take_late(self, fit: Fit) -> None:
        """From now on fit a late record along, in a search that begins anew."""
        number = len(fit.terms) - 1
        law = fit.terms[number].moved(fit.u[fit.columns(number)])
        self.slugs = tuple(late_record.untouched(self.slugs, law))
        # Beside the late record the base may go as far again from here; the balance of forces does not know of it.
        base = {item.slug: fit.u[fit.columns(k).start] for k, item in enumerate(fit.terms) if item.slug in BASE_WORDS}
        self.balance = Balanced({**self.balance.values, **{slug: math.exp(u) for slug, u in base.items()}})
        self.known = (*self.known, late_record.along(law))
        self._seen.clear()
        self._others.clear()
        self._likeliest.clear()
        del self.given

    def _askable(self, present: LawSet) -> list[str]:
        """Laws that may join a set: not those in it, those that are the same, or that a device cannot have besides."""
        laws = set(present.laws)
        laws |= {
            other for slug in present.laws for other in (*CATALOGUE[slug].equivalent_to, *CATALOGUE[slug].excludes)
        }
        if len(_CORRECTIONS & laws) > 2:
            laws |= _CORRECTIONS
        return [slug for slug in self.slugs if slug not in laws]

    def _added(self, present: LawSet, *, is_free: bool) -> Round | None:
        """The best set with one law more, if it is better."""
        others = [slug for slug in present.laws if not (is_free and slug in BASE_WORDS)]
        if len(others) >= constants.MOST_EFFECTS or is_quiet(present.fit):
            return None
        slugs = self._askable(present)
        if is_free:
            slugs = [slug for slug in slugs if slug not in _CORRECTIONS]
        sets = extensions(present, slugs, self.least)
        if (
            not self.is_asked
        ):  # a grip has six numbers: it is asked about where nothing simpler explains what is missing
            sets.sort(key=lambda one: one.laws[-1] == grip.SLUG)

        def is_named(one: LawSet) -> bool:
            return is_better(one, present, self.needed).is_better and (is_free or self._is_not_base(one, present))

        best = next(filter(is_named, sets), None)
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
            # Without the law the base took its place, and a rough likelihood does not let it back.
            top = max(top, finished(self._from_the_model(best)), key=lambda one: one.total)
        comparison = is_better(top, present, self.needed)
        if not (comparison.is_better and keeps_the_drive(top.fit, present.fit)):
            return None
        self._others[law, frozenset(present.laws)] = rivals
        self._noise[law] = present.fit.noise
        return Round("add", law, top, present, comparison, tuple(rivals))

    def _from_the_model(self, laws: LawSet) -> LawSet:
        """The set with base parameters and noise as the model has them, or with its own noise if that is likelier."""
        fit, u = laws.fit, laws.fit.u.copy()
        for number, item in enumerate(fit.terms):
            if item.slug in BASE_WORDS:
                (own,) = item.coordinates
                u[fit.columns(number)] = own.centre
        return LawSet(self._likelier(fit.at(u), self.given.fit.noise), laws.held_out, laws.penalty)

    def _is_fault(self, one: LawSet, present: LawSet) -> bool:
        """Whether a set has a late record more that gains and closes twice the share of a name: it need not be sure."""
        gain, left = evidence(one, present)[0], one.power / present.power
        return late_record.is_late(one.fit.terms[-1]) and gain >= self.least and left < 1.0 - 2.0 * constants.SHARE

    def _revised(self, present: LawSet, newest: int, *, is_free: bool) -> Iterator[Round]:
        """Drop what is no longer needed, and swap what another law now does better; the newest were just asked."""
        number = len(present.laws) - 1 - newest
        while number >= 0:
            law = present.laws[number]
            if (is_free and law in BASE_WORDS) or self._stays(present, law):
                number -= 1
                continue
            poorer = self.without(present, law)
            comparison = is_better(present, poorer, self.needed)
            if not comparison.is_better:
                yield Round("drop", law, poorer, present, comparison)
                present, number = poorer, len(poorer.laws) - 2
                continue
            swapped = self._swapped(present, poorer, law, is_free=is_free)
            if swapped is not None:
                yield swapped
                present, number = swapped.chosen, len(swapped.chosen.laws) - 2
                continue
            number -= 1

    def _swapped(self, present: LawSet, poorer: LawSet, law: str, *, is_free: bool) -> Round | None:
        """The set with another law in the place of one, if that is better."""
        for other in self._in_place(present, poorer, law):
            if frozenset(other.laws) in self._seen or not is_better(other, present, self.needed).is_better:
                continue
            top = finished(other)
            comparison = is_better(top, present, self.needed)
            is_as_close = self._closes_as_much(top, present)
            is_closer = is_as_close and keeps_the_drive(top.fit, present.fit)
            is_closer = is_closer and (is_free or self._is_not_base(top, poorer))
            if comparison.is_better and is_closer and is_better(top, poorer, self.needed).is_better:
                self._rivals.setdefault(top.laws[-1], set()).add(law)
                self._noise[top.laws[-1]] = poorer.fit.noise
                self._seen.add(frozenset(top.laws))
                return Round("swap", law, top, present, comparison)
        return None

    def _unnamed(self, present: LawSet) -> Iterator[Round]:
        """Leave out laws in whose place an unnamed function of one coordinate is better and leaves less, the last first.

        They are compared with a slow disturbance: with a short one a function of the time may take its place.
        """
        for law in reversed([slug for slug in present.laws if slug not in BASE_WORDS]):
            if is_quiet(present.fit):
                return
            poorer = self.without(present, law)
            other = with_function(poorer.with_slow_disturbance, ROUGH * self.least)
            comparison = is_better(other, present.with_slow_disturbance, self.needed) if other else None
            if other and comparison and comparison.is_better and comparison.left < 1.0:
                yield Round("swap", law, poorer, present, comparison, function=other.function)
                present = poorer

    def _in_place(self, present: LawSet, poorer: LawSet, law: str) -> list[LawSet]:
        """Sets with another law in the place of one: its limits, and what competed with it."""
        key = law, frozenset(poorer.laws)
        if key not in self._others:
            others = self._rivals.get(law, set()) | set(CATALOGUE[law].contains)
            if law in _CORRECTIONS:
                others |= {*_CORRECTIONS, *CATALOGUE[law].near}
            if len(_CORRECTIONS.intersection(poorer.laws)) > 1:
                others -= _CORRECTIONS
            asked = [slug for slug in self._askable(poorer) if slug in others - {law}]
            sets = extensions(poorer, asked, self.least) if asked else []
            self._others[key] = [one for one in sets if not late_record.is_late(one.fit.terms[-1])]
        return [one for one in self._others[key] if one.laws[-1] not in present.laws]

    def _in_prior(self, free: LawSet) -> Iterator[Round]:
        """Drop base parameters that have not left their prior; tell three that are wrong by one factor as the fourth."""
        present = free
        while members := [slug for slug in present.laws if slug in BASE_WORDS and not self._stays(present, slug)]:
            if present is free and not any(self._stays(present, slug) for slug in present.laws):
                bare = present
                for slug in members:
                    bare = self._less(bare, slug)
                bare = scored(self._likelier(bare.fit, self.given.fit.noise).maximise(), bare.penalty)
                comparison = is_better(present, bare, self.needed)
                if not comparison.is_better:
                    yield Round("drop", members[0], bare, present, comparison)
                    return
            poorer = [self.without(present, slug) for slug in members]
            asked = [is_better(present, one, self.needed) for one in poorer]
            least = constants.MATTERS * self.given.power
            is_small = [poorer[k].power < least and _is_near_given(present.law(slug)) for k, slug in enumerate(members)]
            dropped = [k for k, one in enumerate(asked) if not one.is_better or is_small[k]]
            if not dropped:
                break
            k = min(dropped, key=lambda k: asked[k].gain)
            yield Round("drop", members[k], poorer[k], present, asked[k])
            present = poorer[k]
        fewer = self._by_a_factor(present)
        if fewer is not None:
            yield fewer

    def _by_a_factor(self, present: LawSet) -> Round | None:
        """The set with a torque constant in the place of base parameters that are all wrong by one factor, if as good."""
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

        for one in each(tried, kept):
            if one.total > present.total + self.least:  # they contain it: from there they are as good, at least
                present = max(present, self._of_factor(one, present), key=lambda laws: laws.total)
            comparison = is_better(one, present, self.needed)
            if comparison.is_better and self._closes_as_much(one, present):
                return Round("swap", members[0], one, present, comparison)
        return Round("begin", "", present) if present is not before else None

    def _of_factor(self, one: LawSet, present: LawSet) -> LawSet:
        """The set with base parameters, from what another set makes of them with a factor."""
        fit = present.fit.with_noise(one.fit.noise)
        u, factor = fit.u.copy(), 1.0 + float(one.law(_FACTOR).start[0])
        for slug in BASE_WORDS:
            if slug in present.laws:
                value = float(one.fit.device()[index_of(BASE_WORDS[slug])]) / factor
                u[fit.columns(present.number(slug))] = math.log(value)
        return scored(fit.at(np.clip(u, fit.lower, fit.upper)).maximise(), present.penalty)

    def _stays(self, laws: LawSet, slug: str) -> bool:
        """Whether an inertia is held where the model's is not: no likelihood is asked about it."""
        if not (self.is_held and slug == _INERTIA):
            return False
        (own,) = laws.law(slug).coordinates
        return not own.lower <= own.centre <= own.upper

    def _less(self, laws: LawSet, slug: str) -> LawSet:
        """The set without a law, at the same coordinates; of a base parameter remains what the model knows of it."""
        number = laws.number(slug)
        known = [item for item in self.known if item.slug == BASE_WORDS.get(slug)]
        fit = laws.fit.replaced(number, known[0]) if known else laws.fit.without(number)
        return LawSet(fit, laws.held_out, laws.penalty)

    def without(self, laws: LawSet, slug: str) -> LawSet:
        """The set without a law, maximised: with the noise that it had before that law, if that is likelier now."""
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
        """The fit with its own noise or another, whichever is likelier: from too little noise no ascent gets away."""
        return max(fit, fit.with_noise(noise), key=lambda one: one.log_likelihood)
