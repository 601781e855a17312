"""The first stage: which effects, from which starts, promise most. One run of the filter for each start.

The difference that a start makes to the predictions is a direction; along it the likelihood is a parabola whose top is the
promise of that start (a score test, Rao 1948). Where the effect is linear in one of its parameters the top says how large it
should be. Orders of a ripple and the time of a grip come out of torques through the linearised filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.effects.spec import Scale
from hapticd.gap import constants
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.filter import SENSOR
from hapticd.gap.kernel.linear import sensitivities
from hapticd.gap.terms import Term, term
from hapticd.plant.layout import index_of as word

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_BEGINNING = 0.3
_CLIMBS = 4
_BASIN = 0.4
"""Difference of the logarithms of two starts that lead to the same maximum."""
_HOPEFUL = 0.02
_WORTH_A_CLIMB = 0.1
"""Share of what an effect must gain that its start must promise to be followed further."""
_PURSUITS = 3
_HALVINGS, _TRIAL_HALVINGS = 6, 2
_COLUMNS = 64
_PIECES = 100
_SHORTEST, _LONGEST = 4, 0.75
_HIGHEST_ORDER = 90
_MOST_ORDERS = 8
_LEAST_ORDER_GAIN = 10.0
_ORDER_SHARE = 0.02


@dataclass(frozen=True)
class Candidate:
    """An effect and where its fit starts.

    Attributes:
        slug: the effect. term: with its start.
        promise: log-likelihood that it promises, nats. penalty: logarithm of the number of discrete choices made for it.
    """

    slug: str
    term: Term
    promise: float
    penalty: float = 0.0


def scale_of(fit: Fit) -> Scale:
    """What the recordings are of the order of."""
    problem, out = fit.problem, fit.out
    series = problem.series

    def quantiles(values: Floats, at: tuple[float, ...]) -> Any:
        return tuple(float(value) for value in np.quantile(values, at))

    p = problem.base
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
    """The best start of every effect on top of a model; `needed`: what one must gain [nats]."""
    scale = scale_of(present)
    space = _Score(present)
    part = _beginning(present) if any(CATALOGUE[slug].acts_on == "memory" for slug in slugs) else space
    found: list[Candidate] = []
    for slug in slugs:
        if slug == "torque_ripple":
            found += _ripple(space, scale)
        elif slug == "hand_impedance":
            found += _grip(space, scale)
        elif any(other in slugs for other in CATALOGUE[slug].equivalent_to if slug == "asymmetric_coulomb"):
            continue
        elif CATALOGUE[slug].acts_on == "input":
            found += _input(space, slug, scale)
        else:
            starts = [term(slug, values, (), 0.1 * scale.travel) for values in CATALOGUE[slug].starts(scale)]
            rough = CATALOGUE[slug].acts_on == "memory"
            tried = [(part if rough else space).along(item) for item in starts]
            found += _apart(sorted(tried, key=lambda candidate: -candidate.promise), _CLIMBS if rough else 1)
    best = max((candidate.promise for candidate in found), default=0.0)
    least = max(_HOPEFUL * best, _WORTH_A_CLIMB * needed)
    followed = _followed(space, part, [candidate for candidate in found if candidate.promise > least])
    first: dict[str, Candidate] = {}
    for candidate in sorted(followed, key=lambda candidate: -candidate.promise):
        first.setdefault(candidate.slug, candidate)
    return list(first.values())


def _followed(whole: _Score, part: _Score, hopeful: Sequence[Candidate]) -> list[Candidate]:
    """Candidates, those climbed whose likelihood is too rough for slopes; of several starts the best goes on."""
    rough = [c for c in hopeful if c.slug == "hand_impedance" or CATALOGUE[c.slug].acts_on == "memory"]
    found = [c for c in hopeful if c not in rough]
    for slug in dict.fromkeys(c.slug for c in rough):
        space = part if CATALOGUE[slug].acts_on == "memory" else whole
        climbs = [_Climb(space, candidate) for candidate in rough if candidate.slug == slug]
        for climb in climbs:
            climb.go(_TRIAL_HALVINGS)
        best = max(climbs, key=lambda climb: climb.fit.log_likelihood)
        best.go(_HALVINGS - _TRIAL_HALVINGS)
        found.append(best.candidate)
    return found


def _apart(tried: Sequence[Candidate], most: int) -> list[Candidate]:
    """The most promising starts that do not lie in each other's basin."""
    chosen: list[Candidate] = []
    for candidate in tried:
        near = (np.abs(np.subtract(candidate.term.start[:1], other.term.start[:1])) < _BASIN for other in chosen)
        if len(chosen) < most and not any(bool(np.all(close)) for close in near):
            chosen.append(candidate)
    return chosen


def _beginning(present: Fit) -> _Score:
    """The first part of the record: what remembers takes ten times as long to filter, and shows at every reversal."""
    problem = replace(present.problem, series=present.problem.series.beginning(_BEGINNING))
    part = present.on(problem)
    part.differentiate()
    return _Score(part, _BEGINNING)


class _Score:
    """Scores of a model's predictions, without what its own coordinates can explain."""

    def __init__(self, present: Fit, share: float = 1.0) -> None:
        self.present = present
        self.score, self.information = present.out["score"], present.out["information"]
        self.weight = 1.0 / share
        self.own = present.own_slopes
        H = (self.own * self.information[:, None]).T @ self.own
        self.inverse = np.linalg.pinv(H) if self.own.size else np.zeros((0, 0))

    def reduced(self, directions: Floats) -> tuple[Floats, Floats]:
        """Gradient (k,) and information (k, k) of directions of the prediction, shape (n, k)."""
        weighted = directions * self.information[:, None]
        g = directions.T @ self.score
        H = weighted.T @ directions
        if self.own.size:
            cross = weighted.T @ self.own
            g = g - cross @ (self.inverse @ (self.own.T @ self.score))
            H = H - cross @ self.inverse @ cross.T
        return g, H

    def along(self, item: Term) -> Candidate:
        """What a term promises, started as well as its direction says."""
        present = self.present
        fit = present.extended(item)
        value, out = fit.log_likelihood, fit.out
        g, H = self.reduced((out["mean"] - present.out["mean"])[:, None])
        factor = float(g[0] / max(H[0, 0], 1e-300))
        amplitude = CATALOGUE[item.slug].amplitude
        if not amplitude:
            step = min(max(factor, 0.0), 1.0)
            promise = step * float(g[0]) - 0.5 * step * step * float(H[0, 0])
            return Candidate(item.slug, item, self.weight * max(promise, value - present.log_likelihood))
        if item.coordinates[0].is_log and factor <= 0.0:
            return Candidate(item.slug, item, 0.0)
        return Candidate(item.slug, item.scaled(amplitude, factor), self.weight * 0.5 * factor * float(g[0]))


def _ripple(space: _Score, scale: Scale) -> list[Candidate]:
    """Orders of a ripple. Those found first take noise away that hid others: looked for again until they stay."""
    found = _pursued(space, scale)
    present = space.present
    for _ in range(_PURSUITS):
        if found is None or found.promise < constants.MATERIAL * present.out.size:
            break
        fit = present.extended(found.term).approach(present.u.size, 2)
        quiet = present.with_noise(fit.noise)
        quiet.differentiate()
        again = _pursued(_Score(quiet), scale)
        if again is None or again.term.fixed == found.term.fixed:
            break
        found = replace(again, promise=max(found.promise, fit.log_likelihood - present.log_likelihood))
    return [] if found is None else [found]


def _pursued(space: _Score, scale: Scale) -> Candidate | None:
    """Orders by matching pursuit; an order needs two wavelengths of travel, or it is any smooth function of position."""
    turn = 2.0 * math.pi
    unit = turn / scale.travel if scale.is_linear else 1.0
    lowest = max(2, math.ceil(2.0 * turn / scale.travel / unit))
    highest = min(_HIGHEST_ORDER, int(0.25 * turn / scale.resolution / unit))
    if highest < lowest:
        return None
    orders = unit * np.arange(lowest, highest + 1)
    x = space.present.out["x"]
    count = orders.size
    angle = orders * x[:, None]
    D = sensitivities(space.present.out, np.concatenate([np.sin(angle), np.cos(angle)], axis=1))
    g, H = space.reduced(D)
    del D, angle
    chosen: list[int] = []
    total = 0.0
    while len(chosen) < _MOST_ORDERS:
        held = [*chosen, *(k + count for k in chosen)]
        rest_g, rest_H = g, H
        if held:
            solved = np.linalg.solve(H[np.ix_(held, held)], H[held])
            rest_g, rest_H = g - solved.T @ g[held], H - H[:, held] @ solved
        gains = np.zeros(count)
        for k in range(count):
            if k not in chosen:
                pair = np.ix_([k, k + count], [k, k + count])
                own = rest_H[pair] + 1e-6 * H[k, k] * np.eye(2)
                gains[k] = 0.5 * rest_g[[k, k + count]] @ np.linalg.solve(own, rest_g[[k, k + count]])
        k = int(np.argmax(gains))
        if gains[k] < max(_LEAST_ORDER_GAIN, _ORDER_SHARE * total):
            break
        chosen.append(k)
        total += float(gains[k])
    if not chosen:
        return None
    held = [*chosen, *(k + count for k in chosen)]
    sizes = np.linalg.solve(H[np.ix_(held, held)], g[held])
    sines, cosines = sizes[: len(chosen)], sizes[len(chosen) :]
    values = {
        "orders": [float(orders[k]) for k in chosen],
        "amplitudes": [float(a) for a in np.maximum(np.hypot(sines, cosines), 1e-9 * scale.torque)],
        "phases": [float(a) for a in np.arctan2(cosines, sines)],
    }
    item = term("torque_ripple", values, ("orders",), 0.1)
    return Candidate("torque_ripple", item, total, len(chosen) * math.log(count))


class _Climb:
    """A compass search, the noise following: with impacts the likelihood is too rough for slopes."""

    def __init__(self, space: _Score, candidate: Candidate) -> None:
        self.space, self.start = space, candidate
        self.fit = space.present.extended(candidate.term)
        self.fit.scan_power()
        self.size = np.array([0.3 if c.is_log else c.scale for c in candidate.term.coordinates])

    def go(self, halvings: int) -> None:
        """Try a step along each coordinate, both ways; then smaller ones."""
        fit, first = self.fit, self.space.present.u.size
        for _ in range(halvings):
            for k in range(self.size.size):
                for sign in (1.0, -1.0):
                    u = fit.u.copy()
                    u[first + k] += sign * self.size[k]
                    if fit.move(u):
                        break
            fit.scan_power()
            self.size *= 0.6

    @property
    def candidate(self) -> Candidate:
        """The candidate where the search stands."""
        present = self.space.present
        promise = self.space.weight * (self.fit.log_likelihood - present.log_likelihood)
        item = self.start.term.moved(self.fit.u[present.u.size :])
        return replace(self.start, term=item, promise=max(promise, self.start.promise))


def _input(space: _Score, slug: str, scale: Scale) -> list[Candidate]:
    """An effect on the current is a known torque for each of its starts: many starts, one linear pass."""
    present = space.present
    series, p = present.problem.series, present.device()
    duration, base, _ = series.currents(p)
    constant = float(p[word("torque_constant")])
    whole = duration.sum(axis=1)

    def best(starts: Sequence[Term]) -> tuple[float, Term]:
        columns = np.empty((series.size, len(starts)))
        for k, item in enumerate(starts):
            q = p.copy()
            item.put(q, item.start)
            columns[:, k] = constant * ((series.currents(q)[1] - base) * duration).sum(axis=1) / whole
        g, H = space.reduced(sensitivities(present.out, columns))
        share = np.clip(g / np.maximum(np.diag(H), 1e-300), 0.0, 1.0)
        promise = share * g - 0.5 * share**2 * np.diag(H)
        k = int(np.argmax(promise))
        return float(promise[k]), starts[k]

    starts = [term(slug, values, (), 0.1 * scale.travel) for values in CATALOGUE[slug].starts(scale)]
    parts = [best(starts[k : k + _COLUMNS]) for k in range(0, len(starts), _COLUMNS)]
    if not parts:
        return []
    _, coarse = max(parts, key=lambda part: part[0])
    step = float(np.log(_ratio(starts)))
    fine = [coarse.moved([coarse.start[0] + step * share]) for share in np.linspace(-1.0, 1.0, _COLUMNS // 2)]
    promise, item = best(fine)
    return [Candidate(slug, item, promise, math.log(len(starts)))]


def _ratio(starts: Sequence[Term]) -> float:
    return math.exp(starts[1].start[0] - starts[0].start[0]) if len(starts) > 1 else 1.1


def _grip(space: _Score, scale: Scale) -> list[Candidate]:
    """The interval in which inertia, damping and stiffness, added, explain most: sums over all intervals at once."""
    out, series = space.present.out, space.present.problem.series
    if int(series.recording[-1]) > 0:
        return []  # the plant's time starts anew with each recording, and so would the grip
    v = out["v"]
    columns = np.stack([np.ones(v.size), -(out["x"] - out["x"].mean()), -v, -np.gradient(v, series.time_s)], axis=1)
    D = sensitivities(out, columns)
    pieces = np.minimum((series.time_s / series.duration_s * _PIECES).astype(np.int64), _PIECES - 1)
    weighted = D * out["information"][:, None]
    g = np.stack([np.bincount(pieces, D[:, k] * out["score"], _PIECES) for k in range(4)], axis=1)
    H = np.stack(
        [np.bincount(pieces, weighted[:, j] * D[:, k], _PIECES) for j in range(4) for k in range(4)], axis=1
    ).reshape(_PIECES, 4, 4)
    G = np.concatenate([np.zeros((1, 4)), np.cumsum(g, axis=0)])
    curve = np.concatenate([np.zeros((1, 4, 4)), np.cumsum(H, axis=0)])
    first, last = np.triu_indices(_PIECES + 1, _SHORTEST)
    sums, curves = G[last] - G[first], curve[last] - curve[first]
    curves = curves + 1e-6 * np.einsum("kij,ij->kij", curves, np.eye(4)) + 1e-30 * np.eye(4)
    sizes = np.linalg.solve(curves, sums[:, :, None])[:, :, 0]
    promise = 0.5 * np.einsum("ki,ki->k", sums, sizes)
    promise[(sizes[:, 1:] < 0.0).sum(axis=1) > 1] = 0.0  # a hand gives no energy; noise may turn one of three
    way = np.concatenate([[0.0], np.cumsum(np.bincount(pieces, np.abs(v), _PIECES))])
    # A hand that never lets go, or only of a shaft at rest, is inertia, friction and a spring.
    promise[(last - first > _LONGEST * _PIECES) | (way[last] - way[first] > _LONGEST * way[-1])] = 0.0
    k = int(np.argmax(promise))
    push, stiffness, damping, inertia = (float(size) for size in sizes[k])
    begin, end = (float(edge) / _PIECES * series.duration_s for edge in (first[k], last[k]))
    small = 0.02
    values = {
        "m_h": max(inertia, small * scale.inertia),
        "b_h": max(damping, small * scale.torque / scale.speeds[3]),
        "k_h": max(stiffness, small * scale.torque / scale.travel),
        "on_s": begin,
        "off_s": end,
    }
    values["rest"] = float(out["x"].mean()) + push / values["k_h"] if stiffness > 0.0 else float(out["x"].mean())
    item = term("hand_impedance", values, (), 0.1 * scale.travel)
    return [Candidate("hand_impedance", item, float(promise[k]), math.log(promise.size))]
