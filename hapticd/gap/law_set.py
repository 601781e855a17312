"""A set of laws, fitted and scored where it was not fitted; and the one question that is asked of two of them.

`is_better` decides what is added, kept, put in another's place, and what these data cannot distinguish.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import constants
from hapticd.gap.kernel.modes import OUTLIER
from hapticd.gap.kernel.ticks import WHITE
from hapticd.gap.missing import missing_power
from hapticd.plant.effect_terms import torque_constant

if TYPE_CHECKING:
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.terms import Term

_NOTHING = 1e-300
_CLOSE = 0.5
"""Nats to which a fit with a slow disturbance is maximised: it is asked whether a law gains more than ten."""
OUTLIER_COSTS = -float(np.log(OUTLIER))
"""Most that one sample can cost [nats]: beyond, it is an outlier (`kernel.modes.OUTLIER`)."""


@dataclass(frozen=True)
class LawSet:
    """A set of laws with its fit and held-out score.

    Attributes:
        fit: maximum of the likelihood.
        held_out: (blocks,) log-likelihood of each block under the estimate without its fold, less `penalty`.
        penalty: logarithm of the number of discrete choices that were made for all of its laws, nats.
        function: coordinate of a flexible function in the set, which has no name; empty for none.
        function_numbers: how many numbers that function has.
    """

    fit: Fit
    held_out: Floats
    penalty: float = 0.0
    function: str = ""
    function_numbers: int = 0

    @cached_property
    def laws(self) -> tuple[str, ...]:
        """Slugs of the laws, in the order in which they were added; faults of the record are none."""
        named = tuple(item.slug for item in self.fit.terms if item.slug in CATALOGUE)
        return (*named, f"unnamed function of the {self.function}") if self.function else named

    @property
    def numbers(self) -> int:
        """How many numbers were fitted."""
        return int(self.fit.u.size) + self.function_numbers

    @property
    def total(self) -> float:
        """Held-out score of all blocks, nats."""
        return float(self.held_out.sum())

    @cached_property
    def power(self) -> float:
        """Mean square of the missing force, (N m)² or N²."""
        return missing_power(self.fit)

    @cached_property
    def with_slow_disturbance(self) -> LawSet:
        """The same with a disturbance that may be slow."""
        slow = scored(self.fit.with_free_memory(_CLOSE))
        return replace(slow, function=self.function, function_numbers=self.function_numbers)

    def number(self, slug: str) -> int:
        """Where a law is among the terms of the fit."""
        return [item.slug for item in self.fit.terms].index(slug)

    def law(self, slug: str) -> Term:
        """A law at its estimate."""
        number = self.number(slug)
        return self.fit.terms[number].moved(self.fit.u[self.fit.columns(number)])


def scored(fit: Fit, penalty: float = 0.0) -> LawSet:
    """Score a fit on blocks that it was not fitted to, one scoring step away (`Fit.held_out`)."""
    held_out = fit.held_out()
    return LawSet(fit, held_out - penalty / held_out.size, penalty)


def evidence(one: LawSet, other: LawSet) -> tuple[float, float]:
    """Held-out gain of one set over another, nats, and the same in standard errors.

    No law gains more where it was not fitted than where it was: more than that is another one's rough likelihood. What the
    better one leaves counts by the other one's variance, as in the ratio of the two likelihoods. To that an encoder's cell
    adds a twelfth of its square (Sheppard 1898): within a cell nothing is seen of how sure a model is.
    """
    gain = one.total - other.total
    fitted = one.fit.log_likelihood - one.penalty - other.fit.log_likelihood + other.penalty
    gain = min(max(gain, min(fitted, 0.0)), max(fitted, 0.0))
    a, b = (one.fit.out, other.fit.out) if gain >= 0.0 else (other.fit.out, one.fit.out)
    series = one.fit.problem.series
    cell = series.resolution**2 / 12.0
    noise = (a["mean"] - b["mean"]) * a["score"] * ((a["variance"] + cell) / (b["variance"] + cell))
    return gain, series.standard_errors(gain, np.clip(noise, -OUTLIER_COSTS, OUTLIER_COSTS))


def is_quiet(fit: Fit) -> bool:
    """Whether the missing force is about what the least noise makes that a device has: nothing is missing then.

    The noise that is fitted does not say it: it is the same all over the record, and what a motion meets but once is not.
    """
    least = float(np.exp(fit.lower[WHITE]))
    least *= torque_constant(fit.device()) / torque_constant(fit.problem.base)  # as of `Fit.noise_values`
    return missing_power(fit) * constants.LASTING_S < (constants.QUIET * least) ** 2


@dataclass(frozen=True)
class Comparison:
    """What `is_better` says, and why.

    Attributes:
        is_better: yes or no. why: in words.
        gain: on held-out blocks, nats. errors: the same in standard errors, over blocks.
        left: share of the other one's missing power.
    """

    is_better: bool
    why: str
    gain: float
    errors: float
    left: float


def is_better(one: LawSet, other: LawSet, needed: float) -> Comparison:
    """Whether a set of laws goes before another one.

    One that has laws more must gain `needed` standard errors on held-out blocks and close a share of the missing power that
    matters, with a disturbance of short memory and with one that may be slow: no law is named that a slow torque
    replaces, unless that leaves twice as much force. Or it leaves nothing. Of two that have laws instead of each other's
    the one with fewer numbers, or which is a limit of the other, is better unless it predicts worse by more than chance.
    """
    compared = _compared(one, other)
    if not set(other.laws) < set(one.laws):
        if compared.gain <= -0.5 * needed**2 and is_quiet(other.fit) and not is_quiet(one.fit):
            return _answer(compared, False, "nothing is missing with the other")
        least = -constants.INDISTINGUISHABLE if _is_simpler(one, other) else constants.INDISTINGUISHABLE
        return _answer(compared, compared.errors > least, "of two that are as good the simpler one")
    if is_quiet(other.fit):
        return _answer(compared, False, "nothing is missing without it")
    if compared.gain >= 0.5 * needed**2 and is_quiet(one.fit):
        # What a record meets but once has no evidence over blocks, and where it leaves nothing it needs none.
        return _answer(compared, True, "nothing is missing with it")
    if compared.errors < needed:
        return _answer(compared, False, "it is not sure")
    if compared.left >= 1.0 - constants.SHARE:
        return _answer(compared, False, "as much force is missing")
    slow = _compared(one.with_slow_disturbance, other.with_slow_disturbance)
    is_sure = slow.errors >= needed and slow.left < 1.0 - constants.SHARE
    if is_sure or slow.left < 1.0 - constants.CLOSED:
        return _answer(compared, True, "it is sure, and less force is missing")
    return _answer(compared, False, "a slow torque explains as much")


def _compared(one: LawSet, other: LawSet) -> Comparison:
    left = one.power / other.power if other.power > _NOTHING else 0.0
    return Comparison(False, "", *evidence(one, other), left)


def _answer(compared: Comparison, answer: bool, why: str) -> Comparison:
    return replace(compared, is_better=answer, why=why)


def _is_simpler(one: LawSet, other: LawSet) -> bool:
    own, others = (set(a.laws) - set(b.laws) for a, b in ((one, other), (other, one)))
    limits = {limit for slug in others & set(CATALOGUE) for limit in CATALOGUE[slug].contains}
    return one.numbers < other.numbers or bool(own & limits)
