"""A hand's grip as a candidate: inertia, damper and spring, and the interval in which they hold on.

The first guess comes out of torques through the linearised filter, for all intervals at once. Then the sizes are fitted, and
the interval is read off two runs of the filter, one with the hand throughout and one without it: a count that the hand
explains better speaks for the hand at that instant, and the best interval is the one with the largest sum.
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
"""Largest part of time and of travel that a grip lasts."""
_SMALL = 0.02
"""Share of the device's own inertia, damping and stiffness from which a size that shows as negative starts."""
_NEAR = 2
"""Pieces by which an ascent may move an edge."""
_EDGES = ("on_s", "off_s")
_PARAMETERS = ("m_h", "b_h", "k_h", *_EDGES, "rest")
_SHIFTS_S = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Changes of an edge that are tried [s]."""
_FALL = 2.0
"""Nats by which an edge that is no worse than the best may be worse."""
_ROUNDS = 10
_SHARES = (1.0, 0.3, 0.1)


def first_grip(space: Score, scale: Scale) -> list[Candidate]:
    """The interval in which inertia, damping and stiffness, added, explain most: sums over all intervals at once."""
    out, series = space.present.out, space.present.problem.series
    if int(series.recording[-1]) > 0:
        return []  # the plant's time starts anew with each recording, and so would the grip
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
    expected_gain[(sizes[:, 1:] < 0.0).sum(axis=1) > 1] = 0.0  # a hand gives no energy; noise may turn one of three
    way = np.concatenate([[0.0], np.cumsum(np.bincount(pieces, np.abs(out["v"]), _PIECES))])
    # A hand that never lets go, or only of a shaft at rest, is inertia, friction and a spring.
    expected_gain[(last - first > _LONGEST * _PIECES) | (way[last] - way[first] > _LONGEST * way[-1])] = 0.0
    k = int(np.argmax(expected_gain))
    begin, end = (float(edge) / _PIECES * series.duration_s for edge in (first[k], last[k]))
    item = _term(sizes[k], begin, end, float(out["x"].mean()), scale)
    return [Candidate(SLUG, item, float(expected_gain[k]), math.log(expected_gain.size))]


def _shortest(fit: Fit) -> int:
    """Fewest pieces in which a grip is looked for: an ascent may take some off again at either edge."""
    return math.ceil(constants.GRIP_BLOCKS * _PIECES / fit.problem.series.blocks) + 2 * _NEAR


def settled(fit: Fit, number: int, scale: Scale) -> Fit:
    """The fit with the sizes and the interval of its grip, term `number`, fitted in turn, as long as that gains."""
    for _ in range(_ROUNDS):
        before = fit.log_likelihood
        fit = _on_best_interval(_resized(fit, number, scale), number, scale)
        fit.scan_power()
        if fit.log_likelihood < before + 1.0:
            break
    return fit


def maximised(fit: Fit, number: int, scale: Scale) -> Fit:
    """The fit with its grip, term `number`, looked for again, and all else maximised, in turn, as long as that gains.

    Beside edges that are off, all else moves to where they seem right: from there a few of the last bits decide which way.
    """
    for _ in range(_ROUNDS):
        before = fit.log_likelihood
        fit = with_close_edges(settled(fit, number, scale), number).maximise()
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
    """Where a parameter of term `number` is among the coordinates."""
    names = [coordinate.name for coordinate in fit.terms[number].coordinates]
    return int(fit.columns(number).start) + names.index(name)


def _torques(fit: Fit) -> Floats:
    """Torques of a unit of push, stiffness, damping and inertia, shape (n, 4)."""
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
    # An ascent moves an edge but little: what wants to grow on and on is no grip.
    near = _NEAR * scale.duration_s / _PIECES
    held = (
        replace(c, lower=values[c.name] - near, upper=values[c.name] + near) if c.name in _EDGES else c
        for c in item.coordinates
    )
    return replace(item, coordinates=tuple(held))


def _interval_and_sizes(fit: Fit) -> tuple[float, float, Floats]:
    """Begin and end [s], and push, stiffness, damping and inertia."""
    p = fit.device()
    m, b, k, begin, end, rest = (float(p[index_of(f"{SLUG}.{name}")]) for name in _PARAMETERS)
    return begin, end, np.array([k * (rest - float(fit.out["x"].mean())), k, b, m])


def _resized(fit: Fit, number: int, scale: Scale) -> Fit:
    """The fit after a Gauss–Newton step in push, stiffness, damping and inertia, in which the hand's torque is linear."""
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
    """The fit with the interval in which the counts speak most for the hand, unless it would hardly let go."""
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
    """Log-likelihood ratio of the hand against no hand, summed up to each of the n counts, shape (n + 1,)."""
    u = fit.u.copy()
    u[[_coordinate(fit, number, name) for name in _EDGES]] = 0.0, 2.0 * fit.problem.series.duration_s
    _, throughout = fit.evaluate(u)
    return np.concatenate([[0.0], np.cumsum(throughout["log_p"] - fit.without(number).out["log_p"])])


def edge_ranges(fit: Fit, number: int) -> dict[int, tuple[float, float]]:
    """Earliest and latest begin and end of the grip [s] that the counts hardly tell from the estimate, by coordinate.

    A hand that takes hold of a shaft at rest shows only when it moves.
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
