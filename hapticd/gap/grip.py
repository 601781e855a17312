"""A hand's grip as a candidate: inertia, damper and spring, and the time interval of the grip.

The start comes from the linearised filter, for all intervals at once. Then inertia, damping and stiffness are fitted. The
interval is the one with the largest sum of log-likelihood ratios, from two runs of the filter: with the hand throughout, and
without it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import constants
from hapticd.gap.kernel.linear import sensitivities
from hapticd.gap.score import Candidate, Score
from hapticd.gap.terms import term
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from hapticd.effects.spec import Scale
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.terms import Term

SLUG = "hand_impedance"
_PIECES = 100
_LONGEST = 0.75
"""Largest share of the time, and of the distance travelled, in a grip."""
_SMALL = 0.02
"""A parameter whose estimate is negative starts from this share of the device's inertia, damping or stiffness."""
_NEAR = 2
"""Pieces by which an ascent may move an edge of the interval."""
_EDGES = ("on_s", "off_s")
_PARAMETERS = ("m_h", "b_h", "k_h", *_EDGES, "rest")
_SHIFTS_S = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Changes of an edge that are tried [s]."""
_FALL = 2.0
"""An edge is as good as the best one up to this loss [nats]."""
_ROUNDS = 10
_SHARES = (1.0, 0.3, 0.1)


def first_grip(space: Score, scale: Scale) -> list[Candidate]:
    """The interval in which added inertia, damping and stiffness explain most, from cumulative sums over all intervals."""
    out, series = space.present.out, space.present.problem.series
    if int(series.recording[-1]) > 0:
        return []  # time starts at 0 in each recording, so the grip would repeat in each
    D = sensitivities(out, _torques(space.present))
    pieces = np.minimum((series.time_s / series.duration_s * _PIECES).astype(np.int64), _PIECES - 1)
    weighted = D * out["information"][:, None]
    g = np.stack([np.bincount(pieces, D[:, k] * out["score"], _PIECES) for k in range(4)], axis=1)
    H = np.stack(
        [np.bincount(pieces, weighted[:, j] * D[:, k], _PIECES) for j in range(4) for k in range(4)], axis=1
    ).reshape(_PIECES, 4, 4)
    G = np.concatenate([np.zeros((1, 4)), np.cumsum(g, axis=0)])
    curve = np.concatenate([np.zeros((1, 4, 4)), np.cumsum(H, axis=0)])
    first, last = np.triu_indices(_PIECES + 1, _shortest(space.present))
    sums, curves = G[last] - G[first], curve[last] - curve[first]
    curves = curves + 1e-6 * np.einsum("kij,ij->kij", curves, np.eye(4)) + 1e-30 * np.eye(4)
    sizes = np.linalg.solve(curves, sums[:, :, None])[:, :, 0]
    expected_gain = 0.5 * np.einsum("ki,ki->k", sums, sizes)
    expected_gain[(sizes[:, 1:] < 0.0).sum(axis=1) > 1] = 0.0  # a hand is passive; noise may make one of three negative
    way = np.concatenate([[0.0], np.cumsum(np.bincount(pieces, np.abs(out["v"]), _PIECES))])
    # A grip over the whole record, or all of its motion, is not identifiable from inertia, friction and a spring.
    expected_gain[(last - first > _LONGEST * _PIECES) | (way[last] - way[first] > _LONGEST * way[-1])] = 0.0
    k = int(np.argmax(expected_gain))
    begin, end = (float(edge) / _PIECES * series.duration_s for edge in (first[k], last[k]))
    item = _term(sizes[k], begin, end, float(out["x"].mean()), scale)
    return [Candidate(SLUG, item, float(expected_gain[k]), math.log(expected_gain.size))]


def _shortest(fit: Fit) -> int:
    """Fewest pieces of a grip: the ascent may shorten it at both edges."""
    return math.ceil(constants.GRIP_BLOCKS * _PIECES / fit.problem.series.blocks) + 2 * _NEAR


def refined(fit: Fit, number: int, scale: Scale) -> Fit:
    """The fit with parameters and interval of its grip, term `number`, fitted alternately as long as that gains."""
    for _ in range(_ROUNDS):
        before = fit.log_likelihood
        fit = _on_best_interval(_resized(fit, number, scale), number, scale)
        fit.scan_power()
        if fit.log_likelihood < before + 1.0:
            break
    return fit


def maximised(fit: Fit, number: int, scale: Scale) -> Fit:
    """The fit with its grip, term `number`, searched again and all else maximised, alternately, as long as that gains.

    With wrong edges the other parameters adapt to them, and rounding decides where a single ascent ends.
    """
    for _ in range(_ROUNDS):
        before = fit.log_likelihood
        fit = with_close_edges(refined(fit, number, scale), number).maximise()
        if fit.log_likelihood < before + 1.0:
            break
    return fit


def with_close_edges(fit: Fit, number: int) -> Fit:
    """The fit with the edges of its grip, term `number`, moved as long as that gains; returns itself."""
    for name in _EDGES:
        at = _coordinate(fit, number, name)
        for shift in _SHIFTS_S:
            for sign in (1.0, -1.0):
                u = fit.u.copy()
                u[at] += sign * shift
                fit.move(u)
    return fit


def _coordinate(fit: Fit, number: int, name: str) -> int:
    """Index of a parameter of term `number` among the coordinates."""
    names = [coordinate.name for coordinate in fit.terms[number].coordinates]
    return int(fit.columns(number).start) + names.index(name)


def _torques(fit: Fit) -> Floats:
    """Torque per unit of constant force, stiffness, damping and inertia, shape (n, 4)."""
    x, v = fit.out["x"], fit.out["v"]
    a = np.gradient(v, fit.problem.series.time_s)
    return np.stack([np.ones(v.size), -(x - x.mean()), -v, -a], axis=1)


def _term(sizes: Floats, begin: float, end: float, middle: float, scale: Scale) -> Term:
    push, stiffness, damping, inertia = (float(size) for size in sizes)
    stiffness = max(stiffness, _SMALL * scale.torque / scale.travel)
    values = {
        "m_h": max(inertia, _SMALL * scale.inertia),
        "b_h": max(damping, _SMALL * scale.torque / max(scale.speeds[3], scale.travel / scale.duration_s)),
        "k_h": stiffness,
        "on_s": begin,
        "off_s": end,
        "rest": middle + float(np.clip(push / stiffness, -scale.travel, scale.travel)),
    }
    item = term(SLUG, values, (), 0.1 * scale.travel)
    # The range of an edge is narrow: an interval that grows without end is not a grip.
    near = _NEAR * scale.duration_s / _PIECES
    held = (
        replace(c, lower=values[c.name] - near, upper=values[c.name] + near) if c.name in _EDGES else c
        for c in item.coordinates
    )
    return replace(item, coordinates=tuple(held))


def _interval_and_sizes(fit: Fit) -> tuple[float, float, Floats]:
    """Begin and end [s], and constant force, stiffness, damping and inertia."""
    p = fit.device()
    m, b, k, begin, end, rest = (float(p[index_of(f"{SLUG}.{name}")]) for name in _PARAMETERS)
    return begin, end, np.array([k * (rest - float(fit.out["x"].mean())), k, b, m])


def _resized(fit: Fit, number: int, scale: Scale) -> Fit:
    """The fit after a Gauss–Newton step in constant force, stiffness, damping and inertia (the torque is linear in them)."""
    begin, end, sizes = _interval_and_sizes(fit)
    out, time_s = fit.out, fit.problem.series.time_s
    D = sensitivities(out, _torques(fit) * ((time_s >= begin) & (time_s < end))[:, None])
    H = (D * out["information"][:, None]).T @ D
    step = np.linalg.solve(H + 1e-6 * np.diag(np.diag(H)) + 1e-30 * np.eye(4), D.T @ out["score"])
    for share in _SHARES:
        trial = fit.replaced(number, _term(sizes + share * step, begin, end, float(out["x"].mean()), scale))
        if trial.log_likelihood > fit.log_likelihood:
            return trial
    return fit


def _on_best_interval(fit: Fit, number: int, scale: Scale) -> Fit:
    """The fit with the interval of the largest log-likelihood ratio, unless that is nearly the whole record."""
    _, _, sizes = _interval_and_sizes(fit)
    series, middle = fit.problem.series, float(fit.out["x"].mean())
    total = _in_favour(fit, number)
    end = int(np.argmax(total - np.minimum.accumulate(total)))
    begin = int(np.argmin(total[: end + 1]))
    way = np.abs(fit.out["v"])
    long = end - begin > _LONGEST * series.size or way[begin:end].sum() > _LONGEST * way.sum()
    if long or end - begin < _shortest(fit) * series.size // _PIECES:
        return fit
    edges = float(series.time_s[max(begin - 1, 0)]), float(series.time_s[end - 1])
    trial = fit.replaced(number, _term(sizes, *edges, middle, scale))
    return trial if trial.log_likelihood > fit.log_likelihood else fit


def _in_favour(fit: Fit, number: int) -> Floats:
    """Log-likelihood ratio of hand to no hand, cumulative over the n counts, shape (n + 1,)."""
    u = fit.u.copy()
    u[[_coordinate(fit, number, name) for name in _EDGES]] = 0.0, 2.0 * fit.problem.series.duration_s
    _, throughout = fit.evaluate(u)
    return np.concatenate([[0.0], np.cumsum(throughout["log_p"] - fit.without(number).out["log_p"])])


def edge_ranges(fit: Fit, number: int) -> dict[int, tuple[float, float]]:
    """Earliest and latest begin and end of the grip [s] that are as likely as the estimate, by coordinate.

    A grip of a shaft at rest has no effect before the shaft moves.
    """
    found = {}
    for name in _EDGES:
        at = _coordinate(fit, number, name)
        ends = []
        for sign in (-1.0, 1.0):
            u = fit.u.copy()
            for shift in reversed(_SHIFTS_S):
                u[at] = fit.u[at] + sign * shift
                if fit.evaluate(u)[0] < fit.log_likelihood - _FALL:
                    break
            ends.append(min(max(float(u[at]), 0.0), fit.problem.series.duration_s))
        found[at] = ends[0], ends[1]
    return found
