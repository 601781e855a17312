"""Errors of the base model's parameters, which are told apart but for a factor that all of them share."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.competition import ROUGH, Contender, Round, cross_validate, evidence, is_as_good
from hapticd.gap.fit import Fit
from hapticd.gap.terms import term

if TYPE_CHECKING:
    from collections.abc import Sequence

CORRECTIONS = tuple(slug for slug, effect in CATALOGUE.items() if effect.acts_on == "base")
"""Effects that are nothing but a base parameter's error."""


def tell_with_one_less(rounds: list[Round], slugs: Sequence[str], base: int, needed: float) -> None:
    """Tell three corrections as two where two of them are by the same factor.

    A device whose inertia, friction and torque constant are wrong by one factor moves as the model does. So that factor may
    be taken out of them all: the two are gone, and the parameter that was right has its inverse.

    Args:
        rounds: changed in place. slugs: effects that may be named. base: terms that come before the effects.
        needed: what an effect must gain, nats.
    """
    named = [number for number, each in enumerate(rounds) if each.taken.slug in CORRECTIONS]
    right = set(CORRECTIONS) - {rounds[number].taken.slug for number in named}
    if len(right) != 1 or not right <= set(slugs):
        return
    last = rounds[-1].taken.judged
    at = {number: last.fit.columns(base + number).start for number in named}
    if any(last.fit.u[at[number]] <= last.fit.lower[at[number]] for number in named):
        return  # none of it is left
    logarithm = {number: float(np.log1p(last.fit.u[at[number]])) for number in named}
    alike = min(combinations(named, 2), key=lambda two: abs(logarithm[two[0]] - logarithm[two[1]]))
    shared = 0.5 * sum(logarithm[number] for number in alike)
    u = last.fit.u.copy()
    for number in named:
        u[at[number]] = np.expm1(logarithm[number] - shared)
    fit = Fit(last.fit.problem, last.fit.terms, u)
    for number in reversed(alike):
        fit = fit.without(base + number)
    with_it = fit.extended(term(slug := right.pop(), {"r": float(np.expm1(-shared))}, (), 1.0))
    fewer = cross_validate(with_it.maximise(tolerance=ROUGH * needed), last.penalty)
    if not is_as_good(fewer, last):
        return
    gone = {slug, *(rounds[number].taken.slug for number in alike)}  # ties with these are now in other words
    for number in reversed(alike):
        del rounds[number]
    for number, each in enumerate(rounds):
        rounds[number] = replace(
            each, indistinguishable=tuple(one for one in each.indistinguishable if one not in gone)
        )
    before = cross_validate(fit.maximise(tolerance=ROUGH * needed), last.penalty)
    rounds.append(Round(before, (Contender(slug, fewer, *evidence(fewer, before)),), ()))
