"""Choose a set of laws: add, drop or replace one, as long as the set gets better (`law_set.is_better`).

The search starts with free base parameters, or with the model's values where those are as good. Free base parameters are
compared with the model's when no law can be added any more (`free_base`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import constants, grip, late_record
from hapticd.gap._free_base import CORRECTIONS, FreeBase
from hapticd.gap.base_model import Balanced
from hapticd.gap.candidates import keeps_the_drive
from hapticd.gap.law_set import Comparison, LawSet, Round, evidence, is_at_noise_level, is_better
from hapticd.gap.propose import ROUGH, extensions, finished
from hapticd.gap.sets import Sets
from hapticd.gap.terms import BASE_WORDS
from hapticd.gap.unnamed import with_function

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hapticd.gap._problem import Problem
    from hapticd.gap.fit import Fit
    from hapticd.gap.terms import Term

_MAXIMISED = 2.0 * constants.INDISTINGUISHABLE
"""Standard errors behind the chosen set, up to which a set is maximised before it is compared."""
_FAR_BEHIND = 12.0
"""Standard errors behind another set, from which a set is not tried any more."""


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
        sets: the given model, and sets without a law. base: the base parameters.
        slugs: laws that may be added. is_asked: whether the user named the laws to consider.
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
        self.sets = Sets(problem, known, len(slugs))
        self.base = FreeBase(self.sets, list(slugs), balance or Balanced({}))
        self.slugs, self.is_asked = tuple(slugs), is_asked
        self._seen: set[frozenset[str]] = set()
        self._with_unsure: list[LawSet] = []
        self._rivals: dict[str, set[str]] = {}
        self._others: dict[tuple[str, frozenset[str]], list[LawSet]] = {}

    def rounds(self) -> Iterator[Round]:
        """The moves, one by one; the set of the last one is the result."""
        present = self.sets.given
        for move in self._moves():
            yield move
            present = move.chosen
        if not self.is_asked:
            yield from self._unnamed(present)

    def _moves(self) -> Iterator[Round]:
        present, is_free = self._first()
        yield Round("begin", "", present)
        while True:
            freed = None if is_free else self.base.freed(present)
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
                break
            is_free, before = False, present
            self._seen.clear()
            for change in self._settled(present):
                yield change
                present = change.chosen
            if evidence(before, present)[0] < self.sets.least:
                break  # the dropped laws explained nothing, so no new law can be needed
        # Laws beside the model's values must predict better than unsure base parameters in their place.
        for one in self._with_unsure:
            if not self.sets.is_better(present, one).is_better:
                present = one
                yield Round("begin", "", present)

    def _settled(self, present: LawSet) -> Iterator[Round]:
        """Keep base parameters that are sure, put the others at the model's values, and drop laws not needed any more."""
        for change in self.base.settled(present):
            yield change
            present = change.chosen
        if self.base.unsure(present):
            self._with_unsure.append(present)
            present = self.base.without_unsure(present)
            yield Round("begin", "", present)
        yield from self._revised(present, 0, is_free=False)

    def named(self, chosen: LawSet) -> list[Named]:
        """The laws of a set, by descending gain, each with the sets that these data do not distinguish from it."""
        found = []
        for slug in chosen.laws:
            reduced = self.sets.without(chosen, slug)
            rivals = self._in_place(chosen, reduced, slug)
            near = [
                one
                for one in rivals
                if self.sets.closes_as_much(one, chosen) and _least_behind(one, chosen) < _MAXIMISED
            ]
            maximised = {id(one): finished(one) for one in near}
            rivals = sorted((maximised.get(id(one), one) for one in rivals), key=lambda one: -one.total)
            ties = [one for one in rivals if self._is_tied(one, chosen, reduced)]
            ranked = [(one.laws[-1], *evidence(one, reduced), max(evidence(chosen, one)[1], 0.0)) for one in rivals]
            found.append(Named(slug, self.sets.is_better(chosen, reduced), tuple(ties), tuple(ranked)))
        return sorted(found, key=lambda one: -one.comparison.gain)

    def _is_tied(self, one: LawSet, chosen: LawSet, reduced: LawSet) -> bool:
        """Whether a set with another law is tied: better than the set with neither law, and near the chosen set."""
        law = next(slug for slug in chosen.laws if slug not in reduced.laws)
        is_worse = evidence(one, chosen)[0] < -self.sets.least
        is_beaten = is_worse and is_at_noise_level(chosen.fit) and not is_at_noise_level(one.fit)
        is_limit = law in CATALOGUE[one.laws[-1]].contains and chosen.numbers < one.numbers
        if is_limit or is_beaten or not self.sets.closes_as_much(one, chosen):
            return False  # a law is never worse than its own limit
        is_near = _least_behind(one, chosen) < constants.INDISTINGUISHABLE
        return is_near and self.sets.is_better(one, reduced).is_better

    def _first(self) -> tuple[LawSet, bool]:
        """The first set, and whether its base parameters are free."""
        given, free = self.sets.given, self.base.first()
        if free is None:
            return given, False
        # A late record has the same signature as wrong base parameters: it is also tried with the given ones.
        slugs = [slug for slug in self._admissible(given) if slug in late_record.OPPOSITES]
        late = [one for one in extensions(given, slugs, self.sets.least) if late_record.is_late(one.fit.terms[-1])]
        for one in sorted([free, *late], key=lambda one: -one.total):
            if one is free and evidence(one, given)[0] >= self.sets.least:
                break  # evidence and missing force are judged later, with laws in the set
            if one is not free and self.sets.is_better(one, given).is_better:
                self._take_late(one.fit)
                return self._first()
        else:
            free = given
        first = self.base.held(free)
        return first, first is not given

    def _take_late(self, fit: Fit) -> None:
        """Include a late record in every further fit, and restart the search."""
        number = len(fit.terms) - 1
        law = fit.terms[number].moved(fit.u[fit.columns(number)])
        self.slugs = tuple(late_record.identifiable(self.slugs, law))
        self.base.with_late_record(fit)
        self.sets.include(late_record.record_term(law))
        self._seen.clear()
        self._with_unsure.clear()
        self._others.clear()

    def _admissible(self, present: LawSet) -> list[str]:
        """Laws that may be added to a set: not in it, not equivalent to one in it, not excluded by one."""
        laws = {*present.laws, *self.base.unsure(present)}
        laws |= {
            other for slug in present.laws for other in (*CATALOGUE[slug].equivalent_to, *CATALOGUE[slug].excludes)
        }
        if len(CORRECTIONS & laws) > 2:
            laws |= CORRECTIONS
        return [slug for slug in self.slugs if slug not in laws]

    def _added(self, present: LawSet, *, is_free: bool) -> Round | None:
        """The best set with one more law, if it is better."""
        others = [slug for slug in present.laws if not (is_free and slug in BASE_WORDS)]
        if len(others) >= constants.MOST_EFFECTS or is_at_noise_level(present.fit):
            return None
        slugs = self._admissible(present)
        if is_free:
            slugs = [slug for slug in slugs if slug not in CORRECTIONS]
        sets = extensions(present, slugs, self.sets.least)
        if (
            not self.is_asked
        ):  # a grip has six numbers: it is asked about where nothing simpler explains what is missing
            sets.sort(key=lambda one: one.laws[-1] == grip.SLUG)
        best = next((one for one in sets if self.sets.is_better(one, present).is_better), None)
        best = best or next((one for one in sets if self._is_fault(one, present)), None)
        if best is None:
            return None
        for other in sets:
            is_limit = other.laws[-1] in CATALOGUE[best.laws[-1]].contains
            if is_limit and is_better(other, best, 0.0).is_better and self.sets.is_better(other, present).is_better:
                best = other
                break
        if late_record.is_late(best.fit.terms[-1]):
            return Round("add", late_record.SLUG, best, present)
        law, rivals = best.laws[-1], [one for one in sets if one is not best and _is_near(one, best)]
        self._rivals[law] = {one.laws[-1] for one in rivals}
        top = finished(best)
        if is_free and CATALOGUE[law].acts_on == "memory":
            # Without the law the base parameters compensated it; a non-smooth likelihood would keep them there.
            top = max(top, finished(self.base.at_the_model(best)), key=lambda one: one.total)
        comparison = self.sets.is_better(top, present)
        if not (comparison.is_better and keeps_the_drive(top.fit, present.fit)):
            return None
        self._others[law, frozenset(present.laws)] = rivals
        self.sets.noise[law] = present.fit.noise
        return Round("add", law, top, present, comparison, tuple(rivals))

    def _is_fault(self, one: LawSet, present: LawSet) -> bool:
        """Whether a set adds a late record that closes twice the share that a law must, whatever its evidence."""
        gain, left = evidence(one, present)[0], one.power / present.power
        return late_record.is_late(one.fit.terms[-1]) and gain >= self.sets.least and left < 1.0 - 2.0 * constants.SHARE

    def _revised(self, present: LawSet, newest: int, *, is_free: bool) -> Iterator[Round]:
        """Drop laws that are no longer needed, and swap laws for better ones, except the `newest` ones, just tested."""
        number = len(present.laws) - 1 - newest
        while number >= 0:
            law = present.laws[number]
            if (is_free and law in BASE_WORDS) or self.base.stays(present, law):
                number -= 1
                continue
            reduced = self.sets.without(present, law)
            comparison = self.sets.is_better(present, reduced)
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
            if frozenset(other.laws) in self._seen or not self.sets.is_better(other, present).is_better:
                continue
            top = finished(other)
            comparison = self.sets.is_better(top, present)
            is_closer = self.sets.closes_as_much(top, present) and keeps_the_drive(top.fit, present.fit)
            if comparison.is_better and is_closer and self.sets.is_better(top, reduced).is_better:
                self._rivals.setdefault(top.laws[-1], set()).add(law)
                self.sets.noise[top.laws[-1]] = reduced.fit.noise
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
            reduced = self.sets.without(present, law)
            other = with_function(reduced.with_slow_disturbance, ROUGH * self.sets.least)
            comparison = self.sets.is_better(other, present.with_slow_disturbance) if other else None
            if other and comparison and comparison.is_better and comparison.left < 1.0:
                yield Round("swap", law, reduced, present, comparison, function=other.function)
                present = reduced

    def _in_place(self, present: LawSet, reduced: LawSet, law: str) -> list[LawSet]:
        """Sets with one law replaced by another: by its limits, and by laws that competed with it."""
        key = law, frozenset(reduced.laws)
        if key not in self._others:
            others = self._rivals.get(law, set()) | set(CATALOGUE[law].contains)
            if law in CORRECTIONS:
                others |= {*CORRECTIONS, *CATALOGUE[law].near}
            if len(CORRECTIONS.intersection(reduced.laws)) > 1:
                others -= CORRECTIONS
            asked = [slug for slug in self._admissible(reduced) if slug in others - {law}]
            sets = extensions(reduced, asked, self.sets.least) if asked else []
            self._others[key] = [one for one in sets if not late_record.is_late(one.fit.terms[-1])]
        return [one for one in self._others[key] if one.laws[-1] not in present.laws]
