"""One round of the selection: which effects compete, what one gains over another, and what may be named."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import constants, grip, late_record, ripple
from hapticd.gap.candidates import HALF_WAY, HALVINGS, PROMISING, Climb, candidates, keeps_the_drive, scale_of
from hapticd.gap.imitation import is_artefact
from hapticd.gap.missing import missing_force, missing_power, structure
from hapticd.gap.parallel import each
from hapticd.gap.remainder import is_all_chance
from hapticd.plant.layout import NAMES, neutral_vector

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.score import Candidate
    from hapticd.gap.terms import Term

_FIRST_STEPS = 3
_SHORTLIST = 8
_MOST_FITTED = 4
_CLIMB = 10
"""Steps of a contender's climb: the one that is taken is climbed to the end."""
_CLOSER = 0.3
"""First steps of the last climb over those of the first."""
_CLOSEST = 0.02
"""The same where a step of a converter, many times over, makes a current: the likelihood is a spike."""
_REMEMBER = {slug for slug, effect in CATALOGUE.items() if effect.acts_on == "memory"}
ROUGH = 0.2
"""Share of what an effect must gain to which contenders are fitted; the one that is taken is fitted to the end."""


@dataclass(frozen=True)
class CrossValidated:
    """A fit with its held-out score."""

    fit: Fit
    held_out: Floats
    """(blocks,) log-likelihood of each block under the estimate without its fold, less the penalty for discrete choices."""
    penalty: float = 0.0
    """That penalty: the logarithm of the number of discrete choices that were made for all of the model's laws."""

    @property
    def total(self) -> float:
        """Held-out score of all blocks."""
        return float(self.held_out.sum())

    @cached_property
    def beside_slow(self) -> CrossValidated:
        """The same fitted beside a disturbance that may be slow, and judged there; no discrete choice is penalised."""
        return cross_validate(self.fit.with_free_memory())

    def less(self, penalty: float) -> CrossValidated:
        """The same less the logarithm of the number of discrete choices that were made for it."""
        return replace(self, held_out=self.held_out - penalty / self.held_out.size, penalty=self.penalty + penalty)


@dataclass(frozen=True)
class Contender:
    """An effect that competed in a round."""

    slug: str
    judged: CrossValidated
    gain: float
    """Held-out gain over the model before the round, nats."""
    evidence: float
    """The same in standard errors."""
    penalty: float = 0.0
    """Logarithm of the number of discrete choices made for this law."""

    @property
    def law(self) -> Term:
        """The effect at its estimate."""
        fit = self.judged.fit
        number = [item.slug for item in fit.terms].index(self.slug)
        return fit.terms[number].moved(fit.u[fit.columns(number)])


@dataclass(frozen=True)
class Round:
    """One step of the selection."""

    before: CrossValidated
    contenders: tuple[Contender, ...]
    """Best first; the first was taken."""
    indistinguishable: tuple[str, ...]
    """Others that these data do not tell from it."""

    @property
    def taken(self) -> Contender:
        """The one that was added."""
        return self.contenders[0]


def cross_validate(fit: Fit, penalty: float = 0.0) -> CrossValidated:
    """Score a fit; `penalty` is the logarithm of the number of discrete choices that were made for it."""
    return CrossValidated(fit, fit.held_out()).less(penalty)


def evidence(better: CrossValidated, other: CrossValidated) -> tuple[float, float]:
    """Held-out gain of one hypothesis over another, nats, and the same in standard errors.

    No law gains more where it was not fitted than where it was: more than that is another one's rough likelihood. What the
    better one leaves counts by the other one's variance, as in the ratio of the two likelihoods.
    """
    gain = better.total - other.total
    fitted = better.fit.log_likelihood - better.penalty - other.fit.log_likelihood + other.penalty
    gain = min(max(gain, min(fitted, 0.0)), max(fitted, 0.0))
    a, b = (better.fit.out, other.fit.out) if gain >= 0.0 else (other.fit.out, better.fit.out)
    noise = (a["mean"] - b["mean"]) * a["score"] * (a["variance"] / b["variance"])
    return gain, better.fit.problem.series.standard_errors(gain, noise)


def compete(present: CrossValidated, slugs: Sequence[str], needed: float) -> list[Contender]:
    """Fit what promises most on top of the present model, where an effect must gain `needed` nats; best first."""
    found = sorted(candidates(present.fit, slugs, needed), key=lambda candidate: -candidate.promise)
    if not found:
        return []
    likely = [c for c in found[:_SHORTLIST] if c.promise > max(PROMISING * found[0].promise, HALF_WAY * needed)]
    # A law competes with its limits, though eight others promise more.
    limits = {slug for candidate in likely for slug in CATALOGUE[candidate.slug].contains}
    likely += [c for c in found if c.slug in limits and c not in likely]

    def approach(candidate: Candidate) -> tuple[Candidate, Fit, float]:
        fit = _approached(present.fit, candidate)
        gain = fit.log_likelihood - present.fit.log_likelihood if keeps_the_drive(fit, present.fit) else 0.0
        fit.release()
        return candidate, fit, gain

    approached = sorted(each(approach, likely), key=lambda found: -found[2])
    fitted = [(candidate, fit) for candidate, fit, gain in approached if gain >= HALF_WAY * needed]

    def contend(candidate: Candidate, fit: Fit, competitor: float = -np.inf) -> Contender:
        judged = cross_validate(fit.maximise(_CLIMB, ROUGH * needed, competitor), present.penalty + candidate.penalty)
        return Contender(candidate.slug, judged, *evidence(judged, present), candidate.penalty)

    if not fitted:
        return []
    best = contend(*fitted[0])
    others = each(lambda one: contend(*one, best.judged.fit.log_likelihood), fitted[1:_MOST_FITTED])
    return sorted([best, *others], key=lambda contender: -contender.gain)


def _approached(present: Fit, candidate: Candidate) -> Fit:
    """The model with a candidate close enough to its maximum to be compared; what remembers was climbed as a candidate."""
    fit = present.extended(candidate.term)
    if CATALOGUE[candidate.slug].acts_on == "memory":
        fit.scan_power()
        return fit
    return fit.approach(present.u.size, _FIRST_STEPS)


def admitted(contenders: Sequence[Contender], present: CrossValidated, *, is_further: bool) -> list[Contender]:
    """Those that may be named.

    A law at its limit is another law: an answer may be that vague where that closes its share, but does not grow by it. A
    late record is no answer.
    """

    def may_be_vague(contender: Contender) -> bool:
        return not (is_further or late_record.is_late(contender.law)) and closes(contender.judged.fit, present.fit)

    return [
        contender
        for contender in contenders
        if keeps_the_drive(contender.judged.fit, present.fit)
        and (not contender.law.at_bounds(contender.law.start) or may_be_vague(contender))
    ]


def closing(contenders: Sequence[Contender], present: CrossValidated, needed_errors: float) -> list[Contender]:
    """What is sure, and whatever closes its share of the missing force about as well as the best of that.

    Where nothing that is sure closes its share, all that is sure. The likelihood of the next count lives at high
    frequencies, where a recorded current may be late or filtered; the missing force is what the device lacks.
    """
    power = missing_power(present.fit)
    left = {contender.slug: missing_power(contender.judged.fit) for contender in contenders}
    sure = [contender for contender in contenders if contender.evidence >= needed_errors]
    closers = [contender for contender in contenders if left[contender.slug] < (1.0 - constants.SHARE) * power]
    if any(contender in closers for contender in sure):
        kept = closers
    else:  # a late record is no law, and of use only where it closes
        kept = sure = [contender for contender in sure if not late_record.is_late(contender.law)]
    limit = min((left[one.slug] for one in kept if one in sure), default=-np.inf) + constants.FORCE_MARGIN * power
    return [contender for contender in kept if left[contender.slug] <= limit]


def closes(fit: Fit, other: Fit) -> bool:
    """Whether one model leaves less of the missing force than another, by a share that matters."""
    return missing_power(fit) < (1.0 - constants.SHARE) * missing_power(other)


def matters(better: CrossValidated, other: CrossValidated) -> bool:
    """Whether what one model has more is no stand-in for something else, nor for what is not exact in the filter."""
    return is_material(better, other) and not is_artefact(better.fit, other.fit)


def is_material(better: CrossValidated, other: CrossValidated) -> bool:
    """Whether what one model has more closes its share, or leaves nothing but chance where the filter is exact.

    How sure a law is counts for nothing where its model is not right in other respects; where it is, that is enough.
    """
    return closes(better.fit, other.fit) or (is_exact(other.fit) and is_all_chance(better.beside_slow.fit))


def is_exact(fit: Fit) -> bool:
    """Whether the filter takes nothing for known that is not, as contact, twist and bristle of what remembers."""
    differs = fit.device() != neutral_vector()
    return not any(differs[k] for k, name in enumerate(NAMES) if name.partition(".")[0] in _REMEMBER)


def simplest_first(contenders: list[Contender], needed_errors: float) -> list[Contender]:
    """The order of the held-out score, but a law that is a limit of the best one goes before it where it is as good.

    So does any law of the device before a late record that closes no more. What is sure does not give way to what is not.
    """
    best = contenders[0]
    is_late = late_record.is_late(best.law)
    for other in contenders[1:]:
        is_simpler = other.slug in CATALOGUE[best.slug].contains
        is_simpler = is_simpler or (is_late and not closes(best.judged.fit, other.judged.fit))
        is_less_sure = other.evidence < needed_errors <= best.evidence
        if is_simpler and not is_less_sure and is_as_good(other.judged, best.judged):
            return [other, *(contender for contender in contenders if contender is not other)]
    return contenders


def is_as_good(simpler: CrossValidated, other: CrossValidated) -> bool:
    """Whether what the other one gains is no more than chance."""
    return evidence(other, simpler)[1] < constants.INDISTINGUISHABLE


def better_function(before: CrossValidated, judged: CrossValidated, numbers: int, tolerance: float) -> str | None:
    """A coordinate of which a flexible function takes the place of a law that was named, or None.

    Its torque, each block's without its fold, acts on the model without the law, which climbs. It predicts better than the
    law, or as well with no more numbers.

    Args:
        before: the model without the law. judged: with it. numbers: how many the law has.
        tolerance: of the climb, nats.
    """
    functions = structure(before.fit, missing_force(before.fit))
    if not functions:
        return None
    best = max(functions, key=lambda function: function.gain)
    fit = before.fit.under(best.held_out).maximise(tolerance=tolerance)
    ahead = evidence(cross_validate(fit, before.penalty), judged)[1]
    is_simpler = best.numbers <= numbers
    return best.coordinate if ahead > (-1.0 if is_simpler else 1.0) * constants.INDISTINGUISHABLE else None


def indistinguishable_from(best: Contender, others: Sequence[Contender]) -> tuple[str, ...]:
    """Laws that the data do not tell from the best one."""
    return tuple(
        other.slug
        for other in others
        if other.evidence > constants.INDISTINGUISHABLE
        and is_indistinguishable(best.slug, other.slug, evidence(other.judged, best.judged)[1])
    )


def is_indistinguishable(best: str, other: str, ahead: float) -> bool:
    """Whether another law, `ahead` of the best one by so many standard errors, may be the true one instead.

    A law that the best one is a limit of is always as good, and does not count.
    """
    return best not in CATALOGUE[other].contains and ahead > -constants.INDISTINGUISHABLE


def round_of(before: CrossValidated, contenders: Sequence[Contender], *, to_the_end: bool = True) -> Round:
    """A round in which the first of the contenders is taken, climbed to the end and judged there.

    So is whatever is about as good: a climb that was left early is no reason to tell two laws apart.
    """
    best, *others = contenders
    if to_the_end:
        best = finished(best, before)
        others = [finished(other, before) if _is_near(other, best) else other for other in others]
    new = Round(before, (best, *others), indistinguishable_from(best, others))
    for other in others:
        other.judged.fit.release()
    return new


def _is_near(other: Contender, best: Contender) -> bool:
    ahead = evidence(other.judged, best.judged)[1]
    return -2.0 * constants.INDISTINGUISHABLE < ahead <= -constants.INDISTINGUISHABLE


def finished(contender: Contender, before: CrossValidated) -> Contender:
    """The contender climbed to the end, and judged there against the model before the round."""
    fit, added_penalty = _polished(copy.copy(contender.judged.fit))  # the contender may be asked again
    contender.judged.fit.release()
    own = added_penalty if contender.slug == ripple.SLUG else 0.0
    judged = cross_validate(fit, contender.judged.penalty + added_penalty)
    return Contender(contender.slug, judged, *evidence(judged, before), contender.penalty + own)


def _polished(fit: Fit) -> tuple[Fit, float]:
    """The fit climbed to the end, and the penalty for more discrete choices in it.

    A grip, or orders of a ripple, that were found beside what was still missing are looked for again; the edges of a grip
    once more whenever all else has moved, since a climb from edges that are off ends beside the maximum. What a device
    remembers was climbed in a part of the record, and fitted by slopes that a rough likelihood does not have; nor has the
    spike of a converter's step, which holds up all others in a common climb.
    """
    added_penalty = 0.0
    for number, item in enumerate(fit.terms):
        acts_on = CATALOGUE[item.slug].acts_on if item.slug in CATALOGUE else ""
        if item.slug == grip.SLUG:
            fit = grip.climbed(fit, number, scale_of(fit))
        elif item.slug == ripple.SLUG:
            fit, more = ripple.settled(fit, number, scale_of(fit))
            added_penalty += more
        elif acts_on == "memory":
            Climb(fit, number, _CLOSER).go(HALVINGS)
        elif acts_on == "input":
            Climb(fit, number, _CLOSEST).go(2 * HALVINGS)
            fit.in_turn(_CLIMB)
    return fit.maximise(), added_penalty
