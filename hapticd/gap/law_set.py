"""A set of laws with its fit and held-out score, and the comparison of two sets.

`is_better` decides which laws are added, kept or replaced, and which are tied.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import constants
from hapticd.gap.kernel.modes import OUTLIER
from hapticd.gap.kernel.ticks import WHITE
from hapticd.gap.lost_commands import mixture_gain
from hapticd.gap.missing import missing_power
from hapticd.plant.effect_terms import torque_constant

if TYPE_CHECKING:
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.terms import Term

_NOTHING = 1e-300
_CLOSE = 0.5
"""Tolerance of a fit with a slow disturbance [nats]: the gains that it decides on are above ten."""
OUTLIER_COSTS = -float(np.log(OUTLIER))
"""Largest loss of one sample [nats]: beyond it, the sample is an outlier (`kernel.modes.OUTLIER`)."""


@dataclass(frozen=True)
class LawSet:
    """A set of laws with its fit and held-out score.

    Attributes:
        fit: maximum of the likelihood.
        held_out: (blocks,) log-likelihood of each block with parameters estimated without its fold, minus `penalty`.
        penalty: logarithm of the number of discrete choices for all of its laws, nats.
        function: coordinate of an unnamed function in the set; empty for none.
        function_numbers: number of parameters of that function.
    """

    fit: Fit
    held_out: Floats
    penalty: float = 0.0
    function: str = ""
    function_numbers: int = 0

    @cached_property
    def laws(self) -> tuple[str, ...]:
        """Slugs of the laws, in the order in which they were added; without faults of the record."""
        named = tuple(item.slug for item in self.fit.terms if item.slug in CATALOGUE)
        return (*named, f"unnamed function of the {self.function}") if self.function else named

    @property
    def numbers(self) -> int:
        """Number of fitted parameters."""
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
        """The same set, fitted with a disturbance that may be slow."""
        slow = scored(self.fit.with_slow_disturbance(_CLOSE))
        return replace(slow, function=self.function, function_numbers=self.function_numbers)

    def number(self, slug: str) -> int:
        """Index of a law among the terms of the fit."""
        return [item.slug for item in self.fit.terms].index(slug)

    def law(self, slug: str) -> Term:
        """A law, started at its estimate."""
        number = self.number(slug)
        return self.fit.terms[number].moved(self.fit.u[self.fit.columns(number)])


def scored(fit: Fit, penalty: float = 0.0) -> LawSet:
    """A set with the held-out score of a fit (`Fit.held_out`, and `mixture_gain` of lost commands)."""
    held_out = fit.held_out() + fit.problem.series.per_block(mixture_gain(fit))
    return LawSet(fit, held_out - penalty / held_out.size, penalty)


def evidence(one: LawSet, other: LawSet) -> tuple[float, float]:
    """Held-out gain of one set over another, in nats and in standard errors.

    The held-out gain is limited to the gain on the fitted data: a larger one comes from a non-smooth likelihood. The
    residuals of the better set are weighted with the variance of the other, as in the likelihood ratio. Quantisation adds a
    twelfth of the squared cell to both variances (Sheppard 1898).
    """
    gain = one.total - other.total
    fitted = one.fit.log_likelihood - one.penalty - other.fit.log_likelihood + other.penalty
    gain = min(max(gain, min(fitted, 0.0)), max(fitted, 0.0))
    a, b = (one.fit.out, other.fit.out) if gain >= 0.0 else (other.fit.out, one.fit.out)
    series = one.fit.problem.series
    cell = series.resolution**2 / 12.0
    noise = (a["mean"] - b["mean"]) * a["score"] * ((a["variance"] + cell) / (b["variance"] + cell))
    return gain, series.standard_errors(gain, np.clip(noise, -OUTLIER_COSTS, OUTLIER_COSTS))


def is_at_noise_level(fit: Fit) -> bool:
    """Whether the missing force is near the least noise of any device: then nothing is missing.

    The fitted noise is an average over the record, so it cannot show a force that acts only once. The missing force does.
    """
    least = float(np.exp(fit.lower[WHITE]))
    least *= torque_constant(fit.device()) / torque_constant(fit.problem.base)  # as of `Fit.noise_values`
    return missing_power(fit) * constants.LASTING_S < (constants.NOISE_FACTOR * least) ** 2


@dataclass(frozen=True)
class Comparison:
    """Result of `is_better`.

    Attributes:
        is_better: whether the first set is better. why: the reason, in words.
        gain: held-out gain, nats. errors: the same in standard errors.
        left: missing power over that of the other set.
    """

    is_better: bool
    why: str
    gain: float
    errors: float
    left: float


@dataclass(frozen=True)
class Round:
    """One move of the search.

    Attributes:
        move: add, drop or swap; begin: the search goes on from another set. law: the law that is added, dropped or replaced.
        chosen: the set after the move. other: the set it was compared with; None where the search begins.
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


def is_better(one: LawSet, other: LawSet, needed: float) -> Comparison:
    """Whether one set of laws is better than another.

    A set with more laws must gain `needed` standard errors on held-out blocks and remove a relevant share of the missing
    power, both with a fast and with a slow disturbance; with the slow one, to remove half of the power is enough. So no law
    is named that a slow torque explains as well. A set that leaves nothing missing is also better. Of two sets with
    different laws, the one with fewer parameters, or whose law is a limit of the other's, is better unless its prediction
    is worse by more than chance.
    """
    compared = _compared(one, other)
    if not set(other.laws) < set(one.laws):
        if compared.gain <= -0.5 * needed**2 and is_at_noise_level(other.fit) and not is_at_noise_level(one.fit):
            return _answer(compared, False, "nothing is missing with the other")
        least = -constants.INDISTINGUISHABLE if _is_simpler(one, other) else constants.INDISTINGUISHABLE
        return _answer(compared, compared.errors > least, "of two equally good sets the simpler one is taken")
    if is_at_noise_level(other.fit):
        return _answer(compared, False, "nothing is missing without it")
    if compared.gain >= 0.5 * needed**2 and is_at_noise_level(one.fit):
        # An event that occurs once has no evidence over blocks; a law that leaves nothing missing needs none.
        return _answer(compared, True, "nothing is missing with it")
    if compared.errors < needed:
        return _answer(compared, False, "the evidence is not sufficient")
    if compared.left >= 1.0 - constants.SHARE:
        return _answer(compared, False, "as much force is missing as without it")
    slow = _compared(one.with_slow_disturbance, other.with_slow_disturbance)
    is_sure = slow.errors >= needed and slow.left < 1.0 - constants.SHARE
    if is_sure or slow.left < 1.0 - constants.CLOSED:
        return _answer(compared, True, "the evidence is sufficient, and less force is missing")
    return _answer(compared, False, "a slow disturbance explains as much")


def _compared(one: LawSet, other: LawSet) -> Comparison:
    left = one.power / other.power if other.power > _NOTHING else 0.0
    return Comparison(False, "", *evidence(one, other), left)


def _answer(compared: Comparison, answer: bool, why: str) -> Comparison:
    return replace(compared, is_better=answer, why=why)


def _is_simpler(one: LawSet, other: LawSet) -> bool:
    own, others = (set(a.laws) - set(b.laws) for a, b in ((one, other), (other, one)))
    limits = {limit for slug in others & set(CATALOGUE) for limit in CATALOGUE[slug].contains}
    return one.numbers < other.numbers or bool(own & limits)
