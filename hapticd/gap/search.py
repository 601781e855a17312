"""Forward selection: which effect, added to the model, predicts held-out samples best, and is that more than chance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t as student

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import constants, grip, late_record
from hapticd.gap.candidates import HALVINGS, Climb, candidates, scale_of
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, WHITE
from hapticd.gap.missing import MOVES, missing_power
from hapticd.plant.layout import index_of as word

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from hapticd.gap.terms import Term

    Floats = NDArray[np.float64]

_FIRST_STEPS = 3
_SHORTLIST = 8
_PROMISING = 0.05
_HALF_WAY = 0.25
_CLOSE = 0.3
_MOST_FITTED = 4
_QUIET = 2.0
_CLOSER = 0.3
"""First steps of the last climb over those of the first."""
_ROUGH = 0.05
"""Share of what an effect must gain to which contenders are fitted; the one that is taken is fitted to the end."""


@dataclass(frozen=True)
class CrossValidated:
    """A fit with its held-out score."""

    fit: Fit
    held_out: Floats
    """(blocks,) log-likelihood of each block under the estimate without its fold, less the price of discrete choices."""

    @property
    def total(self) -> float:
        """Held-out score of all blocks."""
        return float(self.held_out.sum())

    def less(self, penalty: float) -> CrossValidated:
        """The same less the logarithm of the number of discrete choices that were made for it."""
        return replace(self, held_out=self.held_out - penalty / self.held_out.size)


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
    """Logarithm of the number of discrete choices made for it."""

    @property
    def law(self) -> Term:
        """The effect at its estimate."""
        fit = self.judged.fit
        number = [item.slug for item in fit.terms].index(self.slug)
        return fit.terms[number].moved(fit.u[fit.share(number)])


@dataclass(frozen=True)
class Round:
    """One step of the selection."""

    before: CrossValidated
    contenders: tuple[Contender, ...]
    """Best first; the first was taken."""
    tied: tuple[str, ...]
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

    If the better one is true, the gain varies by the sum of its own scores times the difference of the two predictions; sums
    over blocks make that robust to scores that hang together. Twice the gain over that deviation is the z-statistic of a
    likelihood ratio.
    """
    gain = better.total - other.total
    a, b = better.fit.out, other.fit.out
    shift = a["mean"] - b["mean"]
    noise = shift * a["score"]
    blocks = better.fit.problem.series.per_block(noise)
    deviation = np.sqrt(max(float(np.sum(blocks**2)), float(np.sum(noise**2))) + 4.0)
    return gain, 2.0 * gain / deviation


def critical(problem_blocks: int, tried: int) -> float:
    """Standard errors that an effect needs when `tried` of them compete."""
    return float(student.isf(constants.LEVEL / max(tried, 1), problem_blocks - 1))


def is_quiet(fit: Fit) -> bool:
    """Whether the process noise is about the least that a device has: nothing is missing then."""
    noise = fit.noise_values()
    least = np.exp(fit.lower[WHITE])
    return bool(noise[WHITE] ** 2 + 2.0 * noise[DISTURBANCE] ** 2 * noise[CORRELATION] < (_QUIET * least) ** 2)


def search(
    first: CrossValidated, slugs: Sequence[str], progress: Callable[[float, str], None], rounds: list[Round]
) -> CrossValidated:
    """Add effects as long as held-out samples ask for one.

    Args:
        first: the nominal model. slugs: effects that may be named.
        progress: told the share done and what is being done.
        rounds: out: what happened in each round; an interruption leaves those that were finished. A round that takes a late
            record is the last one: the search is to begin again beside it.

    Returns:
        The last model.
    """
    present, needed = first, constants.MATERIAL * first.fit.out.size
    for number in range(constants.MOST_EFFECTS):
        progress(number / (constants.MOST_EFFECTS + 1), "trying effects")
        if is_quiet(present.fit):
            break
        contenders = compete(present, [slug for slug in slugs if slug not in _settled(rounds)], needed)
        if not contenders:
            break
        needed_errors = critical(present.held_out.size, len(slugs))
        if rounds:  # A law at its limit is another law: an answer may be that vague, but it does not grow by it.
            contenders = [contender for contender in contenders if not contender.law.at_bounds(contender.law.start)]
        contenders = _closing(contenders, present, needed_errors)
        if not contenders:
            break
        contenders = _simplest_first(contenders)
        best = contenders[0]
        contenders = [c for c in contenders if c is best or not late_record.is_late(c.law)]
        if best.evidence < needed_errors or best.gain < needed:
            break
        tied = tuple(
            other.slug
            for other in contenders[1:]
            if best.slug not in CATALOGUE[other.slug].contains
            and other.evidence > constants.TIE
            and evidence(best.judged, other.judged)[1] < constants.TIE
        )
        best = replace(best, judged=cross_validate(_polished(best.judged.fit), best.penalty))
        rounds.append(Round(present, (best, *contenders[1:]), tied))
        if late_record.is_late(best.law):
            return best.judged
        look_back(rounds, len(first.fit.terms), needed_errors, needed)
        present = rounds[-1].taken.judged
    return present


def _polished(fit: Fit) -> Fit:
    """The fit climbed to the end; a grip that was found beside what was still missing is looked for again.

    What a device remembers was fitted to the beginning of the record, by slopes that a rough likelihood does not have.
    """
    for number, item in enumerate(fit.terms):
        if item.slug == grip.SLUG:
            fit = grip.settled(fit, number, scale_of(fit))
        elif item.slug in CATALOGUE and CATALOGUE[item.slug].acts_on == "memory":
            Climb(fit, number, _CLOSER).go(HALVINGS)
    return fit.maximise()


def look_back(rounds: list[Round], base: int, needed_errors: float, needed: float) -> None:
    """Take out again what an effect that was named later makes unnecessary; `base` terms come before the effects.

    And what stood in for something that had no name yet: its limiting law takes its place where that does as well now.
    """
    number = len(rounds) - 1
    while number > 0:
        number -= 1
        last = rounds[-1].taken
        poorer = last.judged.fit.without(base + number).with_noise(rounds[number].before.fit.noise)
        without = cross_validate(poorer.maximise(tolerance=_ROUGH * needed), last.penalty)
        gain, errors = evidence(last.judged, without)
        if errors < needed_errors or gain < needed:
            _take_out(rounds, number, without)
            continue
        limits = set(CATALOGUE[rounds[number].taken.slug].contains) - _settled(rounds)
        contenders = compete(without, sorted(limits), needed) if limits else []
        if contenders and evidence(last.judged, contenders[0].judged)[1] < constants.TIE:
            del rounds[number]
            rounds.append(Round(without, tuple(contenders), ()))
            number = len(rounds) - 1


def _take_out(rounds: list[Round], number: int, without: CrossValidated) -> None:
    """Forget a round; `without` is the last model without its effect."""
    del rounds[number]
    if rounds:
        last = replace(rounds[-1].taken, judged=without)
        rounds[-1] = replace(rounds[-1], contenders=(last, *rounds[-1].contenders[1:]))


def withstanding(first: Fit, rounds: list[Round], tried: int) -> list[CrossValidated]:
    """Judge what was named beside a disturbance that may be slow, and take out of `rounds` what is no more than that.

    What is sure there as well stands; and what makes most of the missing force go, which no slow torque does in its place.

    Args:
        first: the nominal model. rounds: of the search, changed in place. tried: how many effects competed.

    Returns:
        The nominal model and that of each round that is left, fitted with such a disturbance.
    """
    needed = constants.MATERIAL * first.out.size
    freed = [cross_validate(fit.with_free_memory()) for fit in _path(first, rounds, needed)]
    for number in reversed(range(len(rounds))):
        whole, without = freed[-1], freed[number]
        if number + 1 < len(rounds):
            poorer = whole.fit.without(len(first.terms) + number).with_noise(without.fit.noise)
            without = cross_validate(poorer.maximise(tolerance=_ROUGH * needed))
        _, errors = evidence(whole.less(rounds[number].taken.penalty), without)
        left, before = missing_power(whole.fit), missing_power(without.fit)
        is_sure = errors > critical(whole.held_out.size, tried) and left < (1.0 - constants.SHARE) * before
        if not is_sure and left > (1.0 - constants.CLOSED) * before:
            _take_out(rounds, number, without)
            del freed[number + 1]
            freed[-1] = without
    return freed


def _path(first: Fit, rounds: Sequence[Round], needed: float) -> list[Fit]:
    """The nominal model and that of each round, without what was taken out since."""
    path = [rounds[-1].taken.judged.fit if rounds else first]
    for each in reversed(rounds):
        poorer, known = path[0].without(len(path[0].terms) - 1), each.before.fit
        is_known = [item.slug for item in poorer.terms] == [item.slug for item in known.terms]
        path.insert(0, known if is_known else poorer.with_noise(known.noise).maximise(tolerance=_ROUGH * needed))
    return path


def _settled(rounds: Sequence[Round]) -> set[str]:
    """Effects that are named, those that are the same, and those that a device cannot have besides."""
    names = {each.taken.slug for each in rounds}
    return names | {other for name in names for other in (*CATALOGUE[name].equivalent_to, *CATALOGUE[name].excludes)}


def _closing(contenders: list[Contender], present: CrossValidated, needed_errors: float) -> list[Contender]:
    """Those that make the missing force smaller; and of those with evidence only such as do it about as well as the best.

    The likelihood of the next count lives at high frequencies, where a recorded current may be late or filtered; the missing
    force is what the device lacks. A law that gains the one without closing the other is none.
    """
    power = missing_power(present.fit)
    left = {contender.slug: missing_power(contender.judged.fit) for contender in contenders}
    contenders = [
        contender
        for contender in contenders
        if left[contender.slug] < (1.0 - constants.SHARE) * power
        and _keeps_the_drive(contender.judged.fit, present.fit)
    ]
    sure = [left[contender.slug] for contender in contenders if contender.evidence >= needed_errors]
    if not sure:
        return []
    limit = min(sure) + constants.FORCE_MARGIN * power
    return [contender for contender in contenders if left[contender.slug] <= limit]


def _keeps_the_drive(fit: Fit, present: Fit) -> bool:
    """Whether a law leaves current and motion their part: one that cancels the drive fits anything."""
    drives = []
    for model in (fit, present):
        p = model.device()
        duration, current, _ = model.problem.series.currents(p)
        constant = p[word("torque_constant")] * (1.0 + p[word("torque_constant_error.r")])
        friction = 1.0 - p[word("load_dependent_friction.kappa")]
        drives.append(constant * friction * float(np.sqrt(np.sum(duration * current**2))))
    moves = [float(np.mean(model.out["v_v"] > MOVES)) for model in (fit, present)]
    return drives[0] > constants.DRIVE_KEPT * drives[1] and moves[0] > constants.DRIVE_KEPT * moves[1]


def _simplest_first(contenders: list[Contender]) -> list[Contender]:
    """The order of the held-out score, but a law that is a limit of the best one goes before it where it is as good.

    So does any law of the device before a late record.
    """
    best = contenders[0]
    for other in contenders[1:]:
        is_simpler = other.slug in CATALOGUE[best.slug].contains or late_record.is_late(best.law)
        if is_simpler and evidence(best.judged, other.judged)[1] < constants.TIE:
            return [other, *(contender for contender in contenders if contender is not other)]
    return contenders


def compete(present: CrossValidated, slugs: Sequence[str], needed: float) -> list[Contender]:
    """Fit what promises most on top of the present model, where an effect must gain `needed` nats; best first."""
    found = sorted(candidates(present.fit, slugs, needed), key=lambda candidate: -candidate.promise)
    if not found:
        return []
    likely = [c for c in found[:_SHORTLIST] if c.promise > max(_PROMISING * found[0].promise, _HALF_WAY * needed)]
    # A law competes with its limits, however little they promise by themselves.
    limits = {slug for candidate in likely for slug in CATALOGUE[candidate.slug].contains}
    likely += [c for c in found if c.slug in limits and c not in likely]
    fits = [(c, present.fit.extended(c.term).approach(present.fit.u.size, _FIRST_STEPS)) for c in likely]
    fits.sort(key=lambda pair: -pair[1].log_likelihood)
    base = present.fit.log_likelihood
    if not fits:
        return []
    contenders: list[Contender] = []
    before = missing_power(present.fit)
    gains = [fit.log_likelihood - base for _, fit in fits]
    closed = [(before - missing_power(fit)) / before for _, fit in fits]
    for (candidate, fit), gain, part in zip(fits, gains, closed, strict=True):
        beaten = (
            gain < _CLOSE * other and part < most + constants.FORCE_MARGIN
            for other, most in zip(gains, closed, strict=True)
        )
        if gain < _HALF_WAY * needed or any(beaten):
            continue
        if len(contenders) == _MOST_FITTED:
            break
        judged = cross_validate(fit.maximise(tolerance=_ROUGH * needed), candidate.penalty)
        gain, errors = evidence(judged, present)
        contenders.append(Contender(candidate.slug, judged, gain, errors, candidate.penalty))
    return sorted(contenders, key=lambda contender: -contender.gain)
