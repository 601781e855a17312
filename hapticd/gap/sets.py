"""Sets of laws of one problem: the model as given, and sets without one of their laws."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from hapticd.gap import chance, constants
from hapticd.gap.law_set import Comparison, LawSet, evidence, is_better, scored
from hapticd.gap.lines import line_term
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.propose import ROUGH
from hapticd.gap.terms import BASE_WORDS, LINE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap._problem import Problem
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.terms import Term


def needed_errors(blocks: int, tried: int) -> float:
    """Standard errors that a law needs if `tried` laws compete (Bonferroni)."""
    return chance.standard_errors(constants.LEVEL / max(tried, 1), blocks)


def likelier(fit: Fit, noise: Floats) -> Fit:
    """The fit with its own noise or another, whichever is likelier: with too little noise no ascent converges."""
    return max(fit, fit.with_noise(noise), key=lambda one: one.log_likelihood)


class Sets:
    """Sets of laws of one problem.

    Attributes:
        problem: what is fitted.
        known: fitted terms that do not count as laws: base parameters with the model's uncertainty as prior, lines, a late
            record.
        needed: standard errors, and least: nats, that a law must gain.
        noise: law to the noise before it was added.
    """

    def __init__(self, problem: Problem, known: Sequence[Term], tried: int) -> None:
        self.problem, self.known = problem, tuple(known)
        self.needed = needed_errors(problem.series.blocks, tried)
        self.least = 0.5 * self.needed**2
        self.noise: dict[str, Floats] = {}
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

    def include(self, item: Term) -> None:
        """Include a term in every further fit."""
        self.known = (*self.known, item)
        self._likeliest.clear()
        del self.given

    def is_better(self, one: LawSet, other: LawSet) -> Comparison:
        """Whether one set is better than another (`law_set.is_better`)."""
        return is_better(one, other, self.needed)

    def closes_as_much(self, one: LawSet, other: LawSet) -> bool:
        """Whether one set leaves as little missing force as another, up to a negligible share."""
        return one.power < other.power + constants.SHARE * self.given.power

    def less(self, laws: LawSet, slug: str) -> LawSet:
        """The set without a law, at the same coordinates; a base parameter keeps the prior of the model, if there is one."""
        number = laws.number(slug)
        known = [item for item in self.known if item.slug in (BASE_WORDS.get(slug), slug)]
        fit = laws.fit.replaced(number, known[0]) if known else laws.fit.without(number)
        return LawSet(fit, laws.held_out, laws.penalty)

    def without(self, laws: LawSet, slug: str) -> LawSet:
        """The set without a law, maximised from its noise or the noise before that law was added, whichever is likelier."""
        fit = self.less(laws, slug).fit
        fit = likelier(fit, self.noise.get(slug, self.given.fit.noise))
        known = self._likeliest.get(_key(fit))
        if known is None or fit.log_likelihood > known.fit.log_likelihood + ROUGH * self.least:
            known = scored(fit.maximise(tolerance=ROUGH * self.least), laws.penalty)
            self._likeliest[_key(fit)] = known
        if laws.penalty == known.penalty:
            return known
        more = (laws.penalty - known.penalty) / known.held_out.size
        return replace(known, held_out=known.held_out - more, penalty=laws.penalty)


def _key(fit: Fit) -> tuple[object, ...]:
    """Identity of a fit's model: its laws, free parameters, and values that are chosen instead of fitted."""
    return tuple(
        sorted((item.slug, tuple((c.name, c.word) for c in item.coordinates), item.fixed) for item in fit.terms)
    )
