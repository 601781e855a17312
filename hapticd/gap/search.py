"""Forward selection: round after round an effect is added, and what was named before is looked at again.

How sure a right name is, and whether less force is missing with it, depends on what else is missing: two errors may make up
for each other. So a law that gains may stay in doubt while the next is looked for, and stands if both are sure beside each
other.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import chance, constants, late_record, lines
from hapticd.gap.candidates import keeps_the_drive
from hapticd.gap.competition import (
    ROUGH,
    Contender,
    CrossValidated,
    Round,
    admitted,
    closes,
    closing,
    compete,
    cross_validate,
    evidence,
    finished,
    is_as_good,
    is_exact,
    is_indistinguishable,
    is_material,
    matters,
    round_of,
    simplest_first,
)
from hapticd.gap.corrections import CORRECTIONS, tell_with_one_less
from hapticd.gap.imitation import is_artefact
from hapticd.gap.kernel.ticks import WHITE
from hapticd.gap.missing import missing_power
from hapticd.gap.remainder import is_all_chance
from hapticd.plant.effect_terms import torque_constant

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.gap.fit import Fit


def critical(blocks: int, tried: int) -> float:
    """Standard errors that an effect needs when `tried` of them compete."""
    return chance.standard_errors(constants.LEVEL / max(tried, 1), blocks)


def least_gain(needed_errors: float) -> float:
    """What an effect with one parameter gains that is just sure, nats: less is not worth a fit."""
    return 0.5 * needed_errors**2


def is_quiet(fit: Fit) -> bool:
    """Whether the missing force is about what the least noise makes that a device has: nothing is missing then.

    The noise that is fitted does not tell: it is the same all over the record, and what a motion meets but once is not.
    """
    least = float(np.exp(fit.lower[WHITE]))
    least *= torque_constant(fit.device()) / torque_constant(fit.problem.base)  # as of `Fit.noise_values`
    return missing_power(fit) * constants.LASTING_S < (constants.QUIET * least) ** 2


def search(
    first: CrossValidated, slugs: Sequence[str], progress: Callable[[float, str], None], rounds: list[Round]
) -> str | None:
    """Add effects as long as held-out samples ask for one, and no slow disturbance does as well.

    Args:
        first: the nominal model. slugs: effects that may be named.
        progress: told the fraction done and what is being done.
        rounds: out: what happened in each round; an interruption leaves those that were finished. A round that takes a late
            record is the last one: the search is to begin again beside it.

    Returns:
        An effect that predicts better for sure and was not named, because with it as much force is missing.
    """
    present, needed_errors = first, critical(first.held_out.size, len(slugs))
    needed = least_gain(needed_errors)
    doubtful: list[Round] = []  # one at most, which may become sure beside the next
    possible: list[Contender] = []
    new: Round | None = None
    for number in range(constants.MOST_EFFECTS):
        progress(number / (constants.MOST_EFFECTS + 1), "trying effects")
        if is_quiet(present.fit):
            rounds += doubtful  # what leaves nothing stands, though it was met too seldom to be sure
            doubtful, new = [], None
            break
        path = [*rounds, *doubtful]
        if not possible:
            tried = [slug for slug in _beside(doubtful, slugs) if slug not in _settled(path)]
            possible = admitted(compete(present, tried, needed), present, is_further=bool(path))
        new = _next(possible, present, needed, needed_errors)
        while new is not None and not admitted([new.taken], present, is_further=bool(path)):
            possible = _others(possible, new)  # climbed to the end it is another law, or none
            new = _next(possible, present, needed, needed_errors)
        is_late = new is not None and late_record.is_late(new.taken.law)
        is_last = number + 1 == constants.MOST_EFFECTS
        is_sure = is_late or (
            new is not None and new.taken.evidence >= needed_errors and matters(new.taken.judged, new.before)
        )
        if new is None or (doubtful and not is_sure) or (is_last and not is_sure):
            break
        path = [*(rounds if is_late else path), new]
        if not is_sure:
            doubtful, present, possible = [new], new.taken.judged, []
            continue
        stands = is_late or _withstands(new, len(slugs))
        if stands and not is_late:
            gone = look_back(path, slugs, len(first.fit.terms), needed_errors, needed)
            tell_with_one_less(path, slugs, len(first.fit.terms), needed)
            if doubtful and not _stand_together(doubtful[0], gone, path, len(rounds)):
                break
            stands = not path or (_withstands(path[-1], len(slugs)) and (path[-1] is new or not _is_artefact(path[-1])))
        if not stands:
            possible = _others(possible, new)
            if doubtful or not possible:
                break
            continue
        rounds[:] = path
        if is_late or not rounds:
            break
        present, doubtful, possible, new = rounds[-1].taken.judged, [], [], None
    for each in (*doubtful, new):
        if each is not None and each.taken.evidence >= needed_errors and not _closes(each) and not _is_artefact(each):
            return each.taken.slug
    return None


def _stand_together(doubtful: Round, gone: set[str], path: Sequence[Round], before: int) -> bool:
    """Whether a name in doubt stands beside the next: less force is missing, or no more names than before do better."""
    if doubtful.taken.slug in gone:
        return False
    return len(path) <= before or closes(path[-1].taken.judged.fit, doubtful.before.fit)


def _next(possible: Sequence[Contender], present: CrossValidated, needed: float, needed_errors: float) -> Round | None:
    """Return the round of what is to be added, surely or in doubt; none without a law that gains what matters.

    In doubt is what gains most of all that closes some of the missing force; else of what is sure, and may stand beside
    another if one of the two is a base parameter (`_beside`). That one moves it: it is not climbed to the end before. Nor is
    a late record, beside which all is fitted anew: no name, it need not be sure.
    """
    contenders = _in_order(closing(possible, present, needed_errors), needed_errors)
    gaining = [one for one in possible if one.gain >= needed]
    is_right = bool(contenders) and _is_right(contenders[0], present, gaining, needed_errors)
    if not is_right:
        closers = [one for one in gaining if closes(one.judged.fit, present.fit)]
        sure = [one for one in gaining if one.evidence >= needed_errors and not late_record.is_late(one.law)]
        contenders = _in_order(closers or sure, needed_errors)
    if not contenders:
        return None
    best = contenders[0]
    if is_artefact(best.judged.fit, present.fit):
        return _next([one for one in possible if one is not best], present, needed, needed_errors)
    to_the_end = not late_record.is_late(best.law) and (is_right or is_material(best.judged, present))
    return round_of(present, contenders, to_the_end=to_the_end)


def _is_right(best: Contender, present: CrossValidated, gaining: Sequence[Contender], needed_errors: float) -> bool:
    """Whether a law is sure and material; one that closes little is not where another closes its share and gains more."""
    if best.evidence < needed_errors:
        return False
    if closes(best.judged.fit, present.fit):
        return True
    if any(one.gain > best.gain and closes(one.judged.fit, present.fit) for one in gaining):
        return False
    return is_material(best.judged, present)


def _others(possible: Sequence[Contender], new: Round) -> list[Contender]:
    return [one for one in possible if one.slug != new.taken.slug]


def _closes(new: Round) -> bool:
    return closes(new.taken.judged.fit, new.before.fit)


def _is_artefact(new: Round) -> bool:
    return is_artefact(new.taken.judged.fit, new.before.fit)


def _beside(doubtful: Sequence[Round], slugs: Sequence[str]) -> Sequence[str]:
    """What may stand beside a name in doubt: of two errors that make up for each other one is a wrong base parameter."""
    if not doubtful or doubtful[0].taken.slug in CORRECTIONS:
        return slugs
    if closes(doubtful[0].taken.judged.fit, doubtful[0].before.fit):
        return slugs
    return [slug for slug in slugs if slug in CORRECTIONS]


def _in_order(contenders: list[Contender], needed_errors: float) -> list[Contender]:
    """Contenders, the one to take first; a late record is no other name for it."""
    best, others = contenders[:1], contenders[1:]
    if contenders:
        best[0], *others = simplest_first(contenders, needed_errors)
    return [*best, *(other for other in others if not late_record.is_late(other.law))]


def look_back(rounds: list[Round], slugs: Sequence[str], base: int, needed_errors: float, needed: float) -> set[str]:
    """Take out again what an effect that was named later makes unnecessary.

    And what stood in for something that had no name yet: a law that was indistinguishable from it takes its place where that
    does better now, its limiting law where that does as well.

    Args:
        rounds: changed in place. slugs: effects that may be named. base: terms that come before the effects.
        needed_errors: evidence that an effect needs. needed: what it must gain, nats.

    Returns:
        What was taken out with nothing in its place.
    """
    number, gone = len(rounds) - 1, set()
    seen = [_names(rounds)]  # each choice of names once, or two could take turns for ever
    while number > 0:
        number -= 1
        last, named = rounds[-1].taken, rounds[number]
        poorer = last.judged.fit.without(base + number, named.before.fit.noise)
        penalty = last.judged.penalty - named.taken.penalty
        without = cross_validate(poorer.maximise(tolerance=ROUGH * needed), penalty)
        gain, errors = evidence(last.judged, without)
        is_closing = closes(last.judged.fit, without.fit)
        if errors < needed_errors or not matters(last.judged, without):
            gone.add(named.taken.slug)
            _take_out(rounds, number, without)
            _reopen(rounds, number)
            number = len(rounds)
            continue
        limits = set(CATALOGUE[named.taken.slug].contains) & set(slugs)
        if named.taken.slug in CORRECTIONS:  # errors of the base go in place of each other
            limits |= set(CORRECTIONS) & set(slugs)
        others = (
            (limits | set(named.indistinguishable))
            - {named.taken.slug}
            - _settled([*rounds[:number], *rounds[number + 1 :]])
        )
        asked = compete(without, sorted(others), needed) if others else []
        close_enough = closing(admitted(asked, without, is_further=True), without, needed_errors)
        competing = [
            finished(one, without)
            for one in close_enough
            if not late_record.is_late(one.law) and (not is_closing or closes(one.judged.fit, without.fit))
        ]
        competing.sort(key=lambda one: -one.gain)
        better = [
            competitor
            for competitor in competing
            if _goes_before(competitor, last, named.taken.slug)
            and _names(rounds) - {named.taken.slug} | {competitor.slug} not in seen
        ]
        if better:
            former = Contender(named.taken.slug, last.judged, gain, errors, named.taken.penalty)
            best = _in_order(better, needed_errors)[0]
            others_of_it = [former, *(competitor for competitor in competing if competitor is not best)]
            del rounds[number]
            _reopen(rounds, number)
            rounds.append(round_of(without, [best, *others_of_it], to_the_end=False))
            seen.append(_names(rounds))
            number = len(rounds) - 1
        else:
            ahead = {competitor.slug: evidence(competitor.judged, last.judged)[1] for competitor in competing}
            still = tuple(
                slug
                for slug in named.indistinguishable
                if is_indistinguishable(named.taken.slug, slug, ahead.get(slug, -np.inf))
            )
            taken = named.taken
            if taken.evidence < needed_errors:  # it was in doubt alone
                taken = replace(taken, gain=gain, evidence=errors)
            rounds[number] = replace(named, contenders=(taken, *named.contenders[1:]), indistinguishable=still)
    return gone


def _goes_before(competitor: Contender, last: Contender, slug: str) -> bool:
    """Whether a law belongs in the place of `slug`, with which the last model was judged."""
    if competitor.slug in CATALOGUE[slug].contains:
        return is_as_good(competitor.judged, last.judged)
    if slug in CATALOGUE[competitor.slug].contains:
        return not is_as_good(last.judged, competitor.judged)
    return competitor.judged.total > last.judged.total


def _names(rounds: Sequence[Round]) -> frozenset[str]:
    return frozenset(each.taken.slug for each in rounds)


def _reopen(rounds: list[Round], number: int) -> None:
    """What was judged beside a law that is gone, from `number` on, is to be asked again with all that competed."""
    for k in range(number, len(rounds)):
        taken, *others = rounds[k].contenders
        asked = (one for one in others if taken.slug not in CATALOGUE[one.slug].contains)
        rounds[k] = replace(
            rounds[k], indistinguishable=tuple(one.slug for one in asked if not late_record.is_late(one.law))
        )


def _take_out(rounds: list[Round], number: int, without: CrossValidated) -> None:
    """Forget a round; `without` is the last model without its effect."""
    del rounds[number]
    if rounds:
        last = replace(rounds[-1].taken, judged=without)
        rounds[-1] = replace(rounds[-1], contenders=(last, *rounds[-1].contenders[1:]))


def withstanding(first: CrossValidated, rounds: list[Round], tried: int) -> list[CrossValidated]:
    """Judge what was named beside a disturbance that may be slow, and take out of `rounds` what is no more than that.

    What is sure there as well stands; and what makes most of the missing force go, which no slow torque does in its place.
    No further effect stands whose parameters end at their limits there: that is another law.

    Args:
        first: the nominal model. rounds: of the search, changed in place. tried: how many effects competed.

    Returns:
        The nominal model and that of each round that is left, fitted with such a disturbance.
    """
    needed = least_gain(critical(first.held_out.size, tried))
    freed = [each.beside_slow for each in _path(first, rounds, needed)]
    if (line := lines.along(freed[0].fit, freed[-1].fit)) is not None:
        with_lines = cross_validate(freed[-1].fit.extended(line).maximise())
        if evidence(with_lines, freed[-1])[1] > critical(first.held_out.size, tried):
            freed = [*(cross_validate(each.fit.extended(line).maximise()) for each in freed[:-1]), with_lines]
    for number in reversed(range(len(rounds))):
        whole, without, at = freed[-1], freed[number], len(first.fit.terms) + number
        if number + 1 < len(rounds):
            poorer = whole.fit.without(at, without.fit.noise)
            without = cross_validate(poorer.maximise(tolerance=ROUGH * needed))
        is_limit = number > 0 and whole.fit.terms[at].at_bounds(whole.fit.u[whole.fit.columns(at)])
        if is_limit or not _is_more(whole.less(rounds[number].taken.penalty), without, tried):
            if number + 1 == len(rounds):
                del rounds[number], freed[-1]
            else:  # what was named later is now judged without it
                _take_out(rounds, number, without)
                between = [each.fit.without(at).maximise(tolerance=ROUGH * needed) for each in freed[number + 2 : -1]]
                freed[number + 1 :] = [*map(cross_validate, between), without]
    return freed


def _withstands(last: Round, tried: int) -> bool:
    """Whether what was named last is more than a slow disturbance."""
    return _is_more(last.taken.judged.beside_slow.less(last.taken.penalty), last.before.beside_slow, tried)


def _is_more(whole: CrossValidated, without: CrossValidated, tried: int) -> bool:
    """Whether a law is sure and matters, or closes most of the missing force, beside a disturbance that may be slow."""
    if not keeps_the_drive(whole.fit, without.fit):
        return False
    _, errors = evidence(whole, without)
    is_sure = errors > critical(whole.held_out.size, tried)
    if is_sure and (closes(whole.fit, without.fit) or (is_exact(without.fit) and is_all_chance(whole.fit))):
        return True
    return missing_power(whole.fit) < (1.0 - constants.CLOSED) * missing_power(without.fit)


def _path(first: CrossValidated, rounds: Sequence[Round], needed: float) -> list[CrossValidated]:
    """The nominal model and that of each round, without what was taken out since."""
    path = [rounds[-1].taken.judged if rounds else first]
    for each in reversed(rounds):
        whole, known = path[0].fit, each.before
        names, own = ([(item.slug, item.fixed) for item in fit.terms] for fit in (whole, known.fit))
        if names[:-1] != own:
            poorer = whole.without(len(names) - 1, known.fit.noise)
            known = cross_validate(poorer.maximise(tolerance=ROUGH * needed))
        path.insert(0, known)
    return path


def _settled(rounds: Sequence[Round]) -> set[str]:
    """Effects that are named, those that are the same, and those that a device cannot have besides."""
    names = {each.taken.slug for each in rounds}
    return names | {other for name in names for other in (*CATALOGUE[name].equivalent_to, *CATALOGUE[name].excludes)}
