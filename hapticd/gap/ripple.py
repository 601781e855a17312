"""Orders of a torque ripple as a candidate, by matching pursuit through the linearised filter."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.kernel.linear import sensitivities
from hapticd.gap.score import Candidate, Score
from hapticd.gap.terms import term

if TYPE_CHECKING:
    from hapticd.effects.spec import Scale
    from hapticd.gap.fit import Fit
    from hapticd.gap.terms import Term

SLUG = "torque_ripple"
_PURSUITS = 3
_HIGHEST_ORDER = 90
_MOST_ORDERS = 8
_LEAST_ORDER_GAIN = 10.0
_ORDER_SHARE = 0.02
_SAME_ORDER = 0.3 / _HIGHEST_ORDER


def first_orders(space: Score, scale: Scale) -> list[Candidate]:
    """Orders of a ripple. Those found first take noise away that hid others: looked for again as long as that helps."""
    found = _pursued(space, scale)
    present, best, most = space.present, found, -math.inf
    for _ in range(_PURSUITS):
        if found is None:
            break
        fit = present.extended(found.term).approach(present.u.size, 2)
        if fit.log_likelihood <= most:
            break
        most = fit.log_likelihood
        best = replace(found, promise=max(found.promise, most - present.log_likelihood))
        quiet = present.with_noise(fit.noise)
        quiet.differentiate()
        again = _pursued(Score(quiet), scale)
        if again is None or again.term.fixed == found.term.fixed:
            break
        found = again
    return [] if best is None else [best]


def settled(fit: Fit, number: int, scale: Scale) -> tuple[Fit, float]:
    """The fit with the orders of its ripple, term `number`, looked for again beside all else, as long as that gains.

    Returns:
        The fit, and the penalty for the orders that it has more, nats.
    """
    added_penalty = 0.0
    for _ in range(_PURSUITS):
        smooth = fit.without(number)
        smooth.differentiate()
        found, present = _pursued(Score(smooth), scale), fit.terms[number]
        if found is None or _are_alike(found.term, present):
            break
        penalty = found.penalty * (1.0 - len(present.fixed) / len(found.term.fixed))
        fit.maximise()
        again = fit.replaced(number, found.term).maximise()
        if again.log_likelihood - penalty <= fit.log_likelihood:
            break
        fit, added_penalty = again, added_penalty + penalty
    return fit, added_penalty


def _are_alike(one: Term, other: Term) -> bool:
    """Whether two ripples have the same orders; on a linear axis their unit is the travel, which is itself an estimate."""
    a, b = (sorted(order for _, order in item.fixed) for item in (one, other))
    return len(a) == len(b) and bool(np.allclose(a, b, rtol=_SAME_ORDER))


def _pursued(space: Score, scale: Scale) -> Candidate | None:
    """Orders by matching pursuit. Over less than a wavelength of travel an order is a smooth function of position."""
    turn = 2.0 * math.pi
    unit = turn / scale.travel if scale.is_linear else 1.0
    lowest = max(2, math.ceil(0.99 * turn / scale.travel / unit))
    highest = min(_HIGHEST_ORDER, int(0.25 * turn / scale.resolution / unit))
    if highest < lowest:
        return None
    orders = unit * np.arange(lowest, highest + 1)
    x = space.present.out["x"]
    count = orders.size
    torques = np.empty((x.size, 2 * count))
    sines, cosines = torques[:, :count], torques[:, count:]
    np.multiply.outer(x, orders, out=sines)
    np.cos(sines, out=cosines)
    np.sin(sines, out=sines)
    D = sensitivities(space.present.out, torques)
    del torques, sines, cosines
    g, H = space.reduced(D)
    del D
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
            # Two orders that drift apart by less than half a wavelength over the travel are one to the data.
            if all(abs(orders[k] - orders[other]) * scale.travel >= 0.5 * turn for other in chosen):
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
    of_sine, of_cosine = sizes[: len(chosen)], sizes[len(chosen) :]
    values = {
        "orders": [float(orders[k]) for k in chosen],
        "amplitudes": [float(a) for a in np.maximum(np.hypot(of_sine, of_cosine), 1e-9 * scale.torque)],
        "phases": [float(a) for a in np.arctan2(of_cosine, of_sine)],
    }
    item = term(SLUG, values, ("orders",), 0.1)
    return Candidate(SLUG, item, total, len(chosen) * math.log(count))
