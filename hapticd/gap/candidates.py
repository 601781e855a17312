"""Which effects, from which starts, are expected to gain most. Each start costs one run of the filter.

A start changes the predictions along a direction. Along it the likelihood is approximated by a parabola, whose maximum is
the expected gain of that start (score test, Rao 1948). Where the effect is linear in a parameter, the maximum also gives
its value. Orders of a ripple and the interval of a grip are found with the linearised filter.
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
from hapticd.gap.parallel import parallel_map
from hapticd.gap.score import Candidate, Score
from hapticd.gap.terms import BASE_WORDS, Term, term
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from hapticd.gap.arrays import Floats

_MOST_STARTS = 4
_BASIN = 0.4
"""Difference of the logarithms of two starts that lead to the same maximum."""
FOLLOWED_SHARE = 0.02
"""A start is dropped below this share of the best start's expected gain,"""
HALF_WAY = 0.5
"""and below this share of the gain that an effect needs."""
HALVINGS, _TRIAL_HALVINGS = 6, 2
_COLUMNS = 16
_INPUTS_TRIED = 6


def scale_of(fit: Fit) -> Scale:
    """Orders of magnitude of the recordings."""
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
        slowest=_slowest(fit),
    )


def _slowest(fit: Fit) -> float:
    """`Scale.slowest`, rad/s or m/s; 0 without a reversal."""
    velocity = fit.out["v"][moving(fit)]
    beside = 2 * int(np.count_nonzero(np.diff(np.sign(velocity))))
    return 0.5 * float(np.partition(np.abs(velocity), beside)[beside]) if 0 < beside < velocity.size else 0.0


def candidates(present: Fit, slugs: Sequence[str], needed: float) -> list[Candidate]:
    """The best start of each effect and sign, added to a model; `needed`: gain that an effect needs [nats]."""
    scale = scale_of(present)
    space = Score(present)
    look = present.on(present.problem.subsample())
    look.differentiate()
    part = Score(look, look.out.size / present.out.size)
    found: list[Candidate] = []
    for number, slug in enumerate(slugs):
        if set(CATALOGUE[slug].equivalent_to) & set(slugs[number:]):
            continue  # of equivalent laws only the last is tried
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
                parallel_map((part if remembers else space).along, starts),
                key=lambda candidate: -candidate.expected_gain,
            )
            if remembers:
                closest = sorted(tried, key=lambda candidate: candidate.left)
                found += _distinct([*_distinct(tried, _MOST_STARTS // 2), *closest], _MOST_STARTS)
            else:
                found += _of_each_sign(tried)
    least = max(FOLLOWED_SHARE * max((c.expected_gain for c in found), default=0.0), HALF_WAY * needed)
    hopeful = parallel_map(
        lambda c: _gripped(space, c, scale) if c.slug == grip.SLUG else space.doubled(c),
        (c for c in found if c.expected_gain > least or c.left < 1.0 - constants.STRUCTURE_SHARE),
    )
    followed = _improved(space, part, hopeful)
    best_of: dict[tuple[str, bool], Candidate] = {}
    for candidate in sorted(followed, key=lambda candidate: -candidate.expected_gain):
        best_of.setdefault((candidate.slug, _is_negative(candidate)), candidate)
    return list(best_of.values())


def keeps_the_drive(fit: Fit, present: Fit) -> bool:
    """Whether a model keeps enough driving torque and motion: a law that cancels the drive would fit any recording."""
    drives = []
    for model in (fit, present):
        p = model.device()
        duration, current, _ = model.problem.series.currents(p, model.filter_s())
        friction = 1.0 - p[index_of("load_dependent_friction.kappa")]
        drives.append(torque_constant(p) * friction * float(np.sqrt(np.sum(duration * current**2))))
    moves = [float(np.mean(moving(model))) for model in (fit, present)]
    return drives[0] >= constants.DRIVE_KEPT * drives[1] and moves[0] >= constants.DRIVE_KEPT * moves[1]


def _started(present: Fit, slug: str, values: Values, scale: Scale) -> Term:
    """A law at a start; a base parameter near zero may grow to the size of the device's torques."""
    if slug not in BASE_WORDS:
        return term(slug, values, (), 0.1 * scale.travel, scale.slowest)
    effect, law = CATALOGUE[slug], base_law(present.problem, slug, None, present.filter_s())
    size = max(effect.reach(scale) / effect.parameters[0].upper, 1.0) if effect.reach else 1.0
    return law.moved([law.coordinates[0].centre + math.log1p(size * float(values["r"]))])


def both_signs(starts: Iterable[Term]) -> list[Term]:
    """Starts with both signs: the sign of a friction changes whether the shaft sticks, so no start reaches the other one."""
    found = list(starts)
    signed = [item for item in found if CATALOGUE[item.slug].amplitude and item.is_signed]
    return found + [item.scaled(CATALOGUE[item.slug].amplitude, -1.0) for item in signed]


def _gripped(space: Score, candidate: Candidate, scale: Scale) -> Candidate:
    fit = space.present.extended(candidate.term)
    fit.scan_power()
    fit = grip.refined(fit, len(fit.terms) - 1, scale)
    expected_gain = fit.log_likelihood - space.present.log_likelihood
    return replace(candidate, term=fit.terms[-1].moved(fit.u[space.present.u.size :]), expected_gain=expected_gain)


def _improved(space: Score, part: Score, hopeful: Sequence[Candidate]) -> list[Candidate]:
    """Candidates, those with a non-smooth likelihood maximised by a compass search; of several starts the best is kept.

    The search runs on a subsample; the expected gain is that on the whole record.
    """
    rough = [c for c in hopeful if CATALOGUE[c.slug].acts_on == "memory"]
    found = [c for c in hopeful if c not in rough]

    def follow(slug: str) -> Candidate | None:
        tried = [candidate for candidate in rough if candidate.slug == slug]
        ascents = [Ascent(part.present.extended(candidate.term), -1) for candidate in tried]
        parallel_map(lambda ascent: ascent.go(_TRIAL_HALVINGS), ascents)
        k = int(np.argmax([ascent.fit.log_likelihood for ascent in ascents]))
        if ascents[k].fit.log_likelihood < part.present.log_likelihood:
            return None  # smaller steps will not gain either
        ascents[k].go(HALVINGS - _TRIAL_HALVINGS)
        item = tried[k].term.moved(ascents[k].fit.u[ascents[k].own])
        whole = space.present.extended(item)
        whole.scan_power()
        expected_gain = whole.log_likelihood - space.present.log_likelihood
        return (
            replace(tried[k], term=item, expected_gain=expected_gain) if keeps_the_drive(whole, space.present) else None
        )

    followed = parallel_map(follow, dict.fromkeys(c.slug for c in rough))
    return found + [candidate for candidate in followed if candidate is not None]


def _is_negative(candidate: Candidate) -> bool:
    return candidate.slug not in BASE_WORDS and candidate.term.is_signed and candidate.term.start[0] < 0.0


def _of_each_sign(tried: Sequence[Candidate]) -> list[Candidate]:
    """The best start of each sign."""
    best: dict[bool, Candidate] = {}
    for candidate in tried:
        best.setdefault(_is_negative(candidate), candidate)
    return list(best.values())


def _distinct(tried: Sequence[Candidate], most: int) -> list[Candidate]:
    """The best starts, no two of which lead to the same maximum."""
    chosen: list[Candidate] = []
    for candidate in tried:
        near = (np.abs(np.subtract(candidate.term.start[:1], other.term.start[:1])) < _BASIN for other in chosen)
        if len(chosen) < most and not any(bool(np.all(close)) for close in near):
            chosen.append(candidate)
    return chosen


class Ascent:
    """A compass search for one term, with the noise rescaled: with impacts the likelihood is not smooth."""

    def __init__(self, fit: Fit, number: int, part: float = 1.0) -> None:
        self.fit, self.own = fit, fit.columns(number)
        self.size = np.array([0.3 * part if c.is_log else part * c.scale for c in fit.terms[number].coordinates])
        fit.scan_power()

    def go(self, halvings: int) -> None:
        """Try a step along each coordinate in both directions; then repeat with smaller steps."""
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
    """Candidates of an effect on the current: each start is a known torque, so one pass of the linearised filter tests all.

    The whole record is used: a current may saturate only once.
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
    """The largest gain of these starts, and its term.

    The best starts are also evaluated exactly: where a current saturates only once, the linearisation is poor there.
    """
    parts = [starts[k : k + _COLUMNS] for k in range(0, len(starts), _COLUMNS)]
    expected = np.concatenate(parallel_map(lambda some: _input_gains(space, some), parts))
    tried = np.argsort(expected)[-_INPUTS_TRIED:].tolist()

    def gain(k: int) -> float:
        return float(max(space.present.extended(starts[k]).log_likelihood - space.present.log_likelihood, expected[k]))

    gains = parallel_map(gain, tried)
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
