"""Forward selection: which effect, added to the model, predicts held-out samples best, and is that more than chance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t as student

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import constants, grip
from hapticd.gap.candidates import candidates, scale_of
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.filter import CORRELATION, DISTURBANCE, WHITE
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
_ROUGH = 0.5
"""Nats to which contenders are fitted; the one that is taken is fitted to the end."""


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
    scores = fit.held_out()
    return CrossValidated(fit, scores - penalty / scores.size)


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
        rounds: out: what happened in each round; an interruption leaves those that were finished.

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
        _look_back(rounds, len(first.fit.terms), needed_errors, needed)
        present = rounds[-1].taken.judged
    return present


def _polished(fit: Fit) -> Fit:
    """The fit climbed to the end; a grip that was found beside what was still missing is looked for again."""
    for number, item in enumerate(fit.terms):
        if item.slug == grip.SLUG:
            fit = grip.settled(fit, number, scale_of(fit))
    return fit.maximise()


def _look_back(rounds: list[Round], base: int, needed_errors: float, needed: float) -> None:
    """Take out again what an effect that was named later makes unnecessary; `base` terms come before the effects."""
    for number in reversed(range(len(rounds) - 1)):
        last = rounds[-1].taken
        poorer = last.judged.fit.without(base + number).with_noise(rounds[number].before.fit.noise)
        without = cross_validate(poorer.maximise(tolerance=_ROUGH), last.penalty)
        gain, errors = evidence(last.judged, without)
        if errors < needed_errors or gain < needed:
            del rounds[number]
            rounds[-1] = replace(rounds[-1], contenders=(replace(last, judged=without), *rounds[-1].contenders[1:]))


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
    """The order of the held-out score, but a law that is a limit of the best one goes before it where it is as good."""
    best = contenders[0]
    for other in contenders[1:]:
        if other.slug in CATALOGUE[best.slug].contains and evidence(best.judged, other.judged)[1] < constants.TIE:
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
        judged = cross_validate(fit.maximise(tolerance=_ROUGH), candidate.penalty)
        gain, errors = evidence(judged, present)
        contenders.append(Contender(candidate.slug, judged, gain, errors, candidate.penalty))
    return sorted(contenders, key=lambda contender: -contender.gain)
