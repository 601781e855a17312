"""The first stage: which effects, from which starts, are expected to gain most. One run of the filter for each start.

The difference that a start makes to the predictions is a direction; along it the likelihood is a parabola whose top is the
expected gain of that start (a score test, Rao 1948). Where the effect is linear in one of its parameters the top says how
large it should be. Orders of a ripple and the time of a grip come out of torques through the linearised filter.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.effects.spec import Scale, Values
from hapticd.gap import constants, grip, late_record, ripple
from hapticd.gap.base_model import base_law
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.linear import sensitivities
from hapticd.gap.kernel.ticks import SENSOR
from hapticd.gap.missing import moving
from hapticd.gap.parallel import each
from hapticd.gap.score import Candidate, Score
from hapticd.gap.terms import BASE_WORDS, Term, term
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from hapticd.gap.arrays import Floats

_CLIMBS = 4
_BASIN = 0.4
"""Difference of the logarithms of two starts that lead to the same maximum."""
FOLLOWED_SHARE = 0.02
"""Share of the best start's expected gain that one needs to be followed further."""
HALF_WAY = 0.5
"""The same of what an effect must gain."""
HALVINGS, _TRIAL_HALVINGS = 6, 2
_COLUMNS = 16
_INPUTS_TRIED = 6


def scale_of(fit: Fit) -> Scale:
    """What the recordings are of the order of."""
    problem, out = fit.problem, fit.out
    series = problem.series

    def quantiles(values: Floats, at: tuple[float, ...]) -> Any:
        return tuple(float(value) for value in np.quantile(values, at))

    p = fit.device()
    return Scale(
        inertia=float(p[0]),
        viscous=float(p[1]),
        coulomb=float(p[2]),
        torque_constant=float(p[3]),
        torque=problem.torque,
        resolution=max(series.resolution, float(fit.noise_values()[SENSOR])),
        period_s=series.period_s,
        duration_s=series.duration_s,
        speeds=quantiles(np.abs(out["v"]), (0.1, 0.3, 0.6, 0.9, 0.99)),
        currents=quantiles(np.abs(series.command), (0.5, 0.6, 0.8, 0.9, 0.97, 0.995, 1.0)),
        positions=quantiles(out["x"], (0.01, 0.25, 0.5, 0.75, 0.99)),
        travel=float(np.ptp(out["x"])),
        is_linear=problem.is_linear,
    )


def candidates(present: Fit, slugs: Sequence[str], needed: float) -> list[Candidate]:
    """The best start of every effect on top of a model, of either sign; `needed`: what one must gain [nats]."""
    scale = scale_of(present)
    space = Score(present)
    look = present.on(present.problem.first_look())
    look.differentiate()
    part = Score(look, look.out.size / present.out.size)
    found: list[Candidate] = []
    for number, slug in enumerate(slugs):
        if set(CATALOGUE[slug].equivalent_to) & set(slugs[number:]):
            continue  # the same law in other words: the last of them stands for all
        if slug == ripple.SLUG:
            found += ripple.first_orders(space, scale)
        elif slug == grip.SLUG:
            found += grip.first_grip(space, scale)
        elif CATALOGUE[slug].acts_on == "input":
            found += _input(space, slug, scale)
        else:
            starts = late_record.starts(slug, scale.period_s)
            if not late_record.is_opposite_only(slug, present):
                starts += both_signs(_started(present, slug, values, scale) for values in CATALOGUE[slug].starts(scale))
            remembers = CATALOGUE[slug].acts_on == "memory"
            tried = sorted(
                each((part if remembers else space).along, starts), key=lambda candidate: -candidate.expected_gain
            )
            if remembers:
                closest = sorted(tried, key=lambda candidate: candidate.left)
                found += _apart([*_apart(tried, _CLIMBS // 2), *closest], _CLIMBS)
            else:
                found += _of_each_sign(tried)
    least = max(FOLLOWED_SHARE * max((c.expected_gain for c in found), default=0.0), HALF_WAY * needed)
    hopeful = each(
        lambda c: _gripped(space, c, scale) if c.slug == grip.SLUG else space.stretched(c),
        (c for c in found if c.expected_gain > least or c.left < 1.0 - constants.STRUCTURE_SHARE),
    )
    followed = _followed(space, part, hopeful)
    best_of: dict[tuple[str, bool], Candidate] = {}
    for candidate in sorted(followed, key=lambda candidate: -candidate.expected_gain):
        best_of.setdefault((candidate.slug, _is_negative(candidate)), candidate)
    return list(best_of.values())


def keeps_the_drive(fit: Fit, present: Fit) -> bool:
    """Whether a law leaves current and motion their part: one that cancels the drive fits anything."""
    drives = []
    for model in (fit, present):
        p = model.device()
        duration, current, _ = model.problem.series.currents(p, model.filter_s())
        friction = 1.0 - p[index_of("load_dependent_friction.kappa")]
        drives.append(torque_constant(p) * friction * float(np.sqrt(np.sum(duration * current**2))))
    moves = [float(np.mean(moving(model))) for model in (fit, present)]
    return drives[0] >= constants.DRIVE_KEPT * drives[1] and moves[0] >= constants.DRIVE_KEPT * moves[1]


def _started(present: Fit, slug: str, values: Values, scale: Scale) -> Term:
    """A law at a start; that of a base parameter which is next to nothing reaches as far as the device's torques do."""
    if slug not in BASE_WORDS:
        return term(slug, values, (), 0.1 * scale.travel)
    effect, law = CATALOGUE[slug], base_law(present.problem, slug, None, present.filter_s())
    size = max(effect.reach(scale) / effect.parameters[0].upper, 1.0) if effect.reach else 1.0
    return law.moved([law.coordinates[0].centre + math.log1p(size * float(values["r"]))])


def both_signs(starts: Iterable[Term]) -> list[Term]:
    """Starts, and those with the opposite sign: friction holds a shaft one way and lets it go the other."""
    found = list(starts)
    signed = [item for item in found if CATALOGUE[item.slug].amplitude and item.is_signed]
    return found + [item.scaled(CATALOGUE[item.slug].amplitude, -1.0) for item in signed]


def _gripped(space: Score, candidate: Candidate, scale: Scale) -> Candidate:
    fit = space.present.extended(candidate.term)
    fit.scan_power()
    fit = grip.settled(fit, len(fit.terms) - 1, scale)
    expected_gain = fit.log_likelihood - space.present.log_likelihood
    return replace(candidate, term=fit.terms[-1].moved(fit.u[space.present.u.size :]), expected_gain=expected_gain)


def _followed(space: Score, part: Score, hopeful: Sequence[Candidate]) -> list[Candidate]:
    """Candidates, those maximised whose likelihood is too rough for slopes; of several starts the best goes on.

    They are maximised in a part of the record, and their expected gain is that in the whole.
    """
    rough = [c for c in hopeful if CATALOGUE[c.slug].acts_on == "memory"]
    found = [c for c in hopeful if c not in rough]

    def follow(slug: str) -> Candidate | None:
        tried = [candidate for candidate in rough if candidate.slug == slug]
        ascents = [Ascent(part.present.extended(candidate.term), -1) for candidate in tried]
        each(lambda ascent: ascent.go(_TRIAL_HALVINGS), ascents)
        k = int(np.argmax([ascent.fit.log_likelihood for ascent in ascents]))
        if ascents[k].fit.log_likelihood < part.present.log_likelihood:
            return None  # smaller steps turn no loss into a gain
        ascents[k].go(HALVINGS - _TRIAL_HALVINGS)
        item = tried[k].term.moved(ascents[k].fit.u[ascents[k].own])
        whole = space.present.extended(item)
        whole.scan_power()
        expected_gain = whole.log_likelihood - space.present.log_likelihood
        return (
            replace(tried[k], term=item, expected_gain=expected_gain) if keeps_the_drive(whole, space.present) else None
        )

    followed = each(follow, dict.fromkeys(c.slug for c in rough))
    return found + [candidate for candidate in followed if candidate is not None]


def _is_negative(candidate: Candidate) -> bool:
    return candidate.slug not in BASE_WORDS and candidate.term.is_signed and candidate.term.start[0] < 0.0


def _of_each_sign(tried: Sequence[Candidate]) -> list[Candidate]:
    """The best start, and that of the other sign: friction that rises here is near one that falls there."""
    best: dict[bool, Candidate] = {}
    for candidate in tried:
        best.setdefault(_is_negative(candidate), candidate)
    return list(best.values())


def _apart(tried: Sequence[Candidate], most: int) -> list[Candidate]:
    """The best starts that do not lie in each other's basin."""
    chosen: list[Candidate] = []
    for candidate in tried:
        near = (np.abs(np.subtract(candidate.term.start[:1], other.term.start[:1])) < _BASIN for other in chosen)
        if len(chosen) < most and not any(bool(np.all(close)) for close in near):
            chosen.append(candidate)
    return chosen


class Ascent:
    """A compass search for one term, the noise following: with impacts the likelihood is too rough for slopes."""

    def __init__(self, fit: Fit, number: int, part: float = 1.0) -> None:
        self.fit, self.own = fit, fit.columns(number)
        self.size = np.array([0.3 * part if c.is_log else part * c.scale for c in fit.terms[number].coordinates])
        fit.scan_power()

    def go(self, halvings: int) -> None:
        """Try a step along each coordinate, both ways; then smaller ones."""
        fit = self.fit
        for _ in range(halvings):
            for k in range(self.size.size):
                for sign in (1.0, -1.0):
                    u = fit.u.copy()
                    u[self.own.start + k] += sign * self.size[k]
                    if fit.move(u):
                        break
            fit.scan_power()
            self.size *= 0.6


def _input(space: Score, slug: str, scale: Scale) -> list[Candidate]:
    """An effect on the current is a known torque for each of its starts: many starts, one linear pass.

    It is looked for in the whole record: a current may reach its limit but once.
    """
    starts = [term(slug, values, (), 0.1 * scale.travel) for values in CATALOGUE[slug].starts(scale)]
    if not starts:
        return []
    _, coarse = _best_input(space, starts)
    step = float(np.log(_ratio(starts)))
    fine = [coarse.moved([coarse.start[0] + step * share]) for share in np.linspace(-1.0, 1.0, _COLUMNS)]
    expected_gain, item = _best_input(space, fine)
    return [Candidate(slug, item, expected_gain, math.log(len(starts)))]


def _best_input(space: Score, starts: Sequence[Term]) -> tuple[float, Term]:
    """The largest expected or real gain of these starts, and which has it.

    The best are tried: where a current meets its limit but once the filter is lost there, and slopes say little.
    """
    parts = [starts[k : k + _COLUMNS] for k in range(0, len(starts), _COLUMNS)]
    expected = np.concatenate(each(lambda some: _input_gains(space, some), parts))
    tried = np.argsort(expected)[-_INPUTS_TRIED:].tolist()

    def gain(k: int) -> float:
        return float(max(space.present.extended(starts[k]).log_likelihood - space.present.log_likelihood, expected[k]))

    gains = each(gain, tried)
    best = int(np.argmax(gains))
    return gains[best], starts[tried[best]]


def _input_gains(space: Score, starts: Sequence[Term]) -> Floats:
    present = space.present
    series, p = present.problem.series, present.device()
    duration, base, _ = series.currents(p)
    constant = torque_constant(p)
    whole = duration.sum(axis=1)
    columns = np.empty((series.size, len(starts)))
    for k, item in enumerate(starts):
        q = p.copy()
        item.put(q, item.start)
        columns[:, k] = constant * ((series.currents(q)[1] - base) * duration).sum(axis=1) / whole
    g, H = space.reduced([sensitivities(present.out, columns)])
    share = np.clip(g / np.maximum(np.diag(H), 1e-300), 0.0, 1.0)
    return np.asarray(share * g - 0.5 * share**2 * np.diag(H))


def _ratio(starts: Sequence[Term]) -> float:
    return math.exp(starts[1].start[0] - starts[0].start[0]) if len(starts) > 1 else 1.1
