"""Orders of a torque ripple as a candidate, by matching pursuit through the linearised filter."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.torque_ripple import ORDERS
from hapticd.gap import chance, constants
from hapticd.gap.kernel.linear import sensitivities
from hapticd.gap.missing import held_out_gain
from hapticd.gap.score import Candidate, Score
from hapticd.gap.terms import term

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from hapticd.effects.spec import Scale
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.terms import Term

SLUG = "torque_ripple"
_PURSUITS = 3
_HIGHEST_ORDER = 90
_SAME_ORDER = 0.3 / _HIGHEST_ORDER
_ROWS = 4096
_SMOOTH = 3
"""Torques besides the orders: constant, spring and gravity."""
_ROUNDING, _NOTHING = 1e-9, 1e-300
_EXCHANGED = 1e-6
"""Least relative increase of the joint gain by an exchange of one order."""


def first_orders(space: Score, scale: Scale) -> list[Candidate]:
    """Orders of a ripple. The first orders lower the noise and may reveal others: the search repeats as long as it gains."""
    found = _pursued(space, scale)
    present, best, most = space.present, found, -math.inf
    for _ in range(_PURSUITS):
        if found is None:
            break
        fit = present.extended(found.term).approach(present.u.size, 2)
        if fit.log_likelihood <= most:
            break
        most = fit.log_likelihood
        best = replace(found, expected_gain=max(found.expected_gain, most - present.log_likelihood))
        quiet = present.with_noise(fit.noise)
        quiet.differentiate()
        again = _pursued(Score(quiet), scale)
        if again is None or again.term.fixed == found.term.fixed:
            break
        found = again
    return [] if best is None else [best]


def refined(fit: Fit, number: int, scale: Scale) -> tuple[Fit, float]:
    """The fit with the orders of its ripple, term `number`, searched again with all other terms, as long as that gains.

    Returns:
        The fit, and the penalty for its additional orders, nats.
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


def orders_left(fit: Fit, scale: Scale) -> list[float]:
    """Orders with significant structure in the held-out innovations of a model."""
    found = _pursued(Score(fit), scale)
    needed = chance.standard_errors(constants.LEVEL / _HIGHEST_ORDER, fit.problem.series.blocks)
    left = []
    for _, order in () if found is None else found.term.fixed:
        turned = order * fit.out["x"]
        answer = sensitivities(fit.out, np.stack([np.sin(turned), np.cos(turned)], axis=1))
        if held_out_gain(fit, answer)[1] > needed:
            left.append(order)
    return left


def _are_alike(one: Term, other: Term) -> bool:
    """Whether two ripples have the same orders; on a linear axis the unit of an order is the travel, itself an estimate."""
    a, b = (sorted(order for _, order in item.fixed) for item in (one, other))
    return len(a) == len(b) and bool(np.allclose(a, b, rtol=_SAME_ORDER))


def _pursued(space: Score, scale: Scale) -> Candidate | None:
    """Orders by matching pursuit, together with smooth torques, which many orders would otherwise approximate.

    An order with less than one wavelength in the travel is itself smooth: it is only accepted together with an order that
    has at least one.
    """
    turn = 2.0 * math.pi
    unit = turn / scale.travel if scale.is_linear else 1.0
    highest = min(_HIGHEST_ORDER, int(0.25 * turn / scale.resolution / unit))
    orders = np.asarray(unit * np.arange(2, highest + 1), dtype=np.float64)
    count = orders.size
    goes_round = np.append(orders * scale.travel >= 0.99 * turn, [False] * _SMOOTH)
    if not goes_round.any():
        return None
    g, H = space.reduced(_directions(space.present, orders, scale.positions[2]))
    # Two orders are not identifiable apart if they differ by less than half a wavelength over the travel.
    one = np.abs(np.subtract.outer(orders, orders)) * scale.travel < 0.5 * turn
    excluded = np.pad(one, (0, _SMOOTH)) | np.eye(count + _SMOOTH, dtype=bool)
    chosen = _best_together(g, H, excluded, goes_round)
    ripple = [k for k in chosen if k < count]
    if not ripple:
        return None
    of_sine, of_cosine = np.linalg.solve(*_system(g, H, chosen))[:, 0].reshape(-1, 2)[np.less(chosen, count)].T
    values = {
        "orders": orders[ripple].tolist(),
        "amplitudes": np.maximum(np.hypot(of_sine, of_cosine), 1e-9 * scale.torque).tolist(),
        "phases": np.arctan2(of_cosine, of_sine).tolist(),
    }
    item = term(SLUG, values, ("orders",), 0.1)
    return Candidate(SLUG, item, _joint_gain(g, H, ripple), len(ripple) * math.log(count))


def _directions(present: Fit, orders: Floats, middle: float) -> Iterator[Floats]:
    """Derivatives of the predictions, `_ROWS` rows at a time, two columns for each order and each smooth torque."""
    state = np.zeros((3, 2 * (orders.size + _SMOOTH)))
    for first in range(0, present.out.size, _ROWS):
        out = present.out[first : first + _ROWS]
        x = out["x"][:, np.newaxis]
        of_sine = [np.sin(x * orders), np.zeros_like(x), x - middle, np.sin(x)]
        of_cosine = [np.cos(x * orders), np.ones_like(x), np.ones_like(x), np.cos(x)]
        columns = np.stack([np.concatenate(of_sine, axis=1), np.concatenate(of_cosine, axis=1)], axis=2)
        yield sensitivities(out, columns.reshape(len(x), -1), state)


def _best_together(g: Floats, H: Floats, excluded: NDArray[np.bool_], goes_round: NDArray[np.bool_]) -> list[int]:
    """Choose from m torques those with the largest joint gain: add the best, then exchange each one for a better one.

    Args:
        g: gradient of the likelihood by the two columns of each torque, shape (2m,). H: their information.
        excluded: (m, m), which torques exclude each other. goes_round: (m,), orders with a wavelength in the travel.
    """
    needs_another = ~goes_round & (np.arange(goes_round.size) < goes_round.size - _SMOOTH)

    def best_beside(others: list[int]) -> tuple[int, Floats]:
        gains = _gains_beside(others, g, H)
        gains[excluded[:, others].any(axis=1)] = 0.0
        if not goes_round[others].any():
            gains[~goes_round if needs_another[others].any() else needs_another] = 0.0
        return int(np.argmax(gains)), gains

    chosen: list[int] = []
    while len(chosen) < ORDERS:
        k, gains = best_beside(chosen)
        if gains[k] < max(constants.ORDER_GAIN, constants.ORDER_SHARE * _joint_gain(g, H, chosen)):
            break
        chosen.append(k)
        expected_gain, unchanged = _joint_gain(g, H, chosen), 0
        while unchanged < len(chosen):
            former, *others = chosen
            exchanged = [*others, best_beside(others)[0]]
            more = _joint_gain(g, H, exchanged)
            # Of the whole set: with the gain of one torque alone, rounding could repeat an exchange forever.
            is_better = more > (1.0 + _EXCHANGED) * expected_gain
            chosen, expected_gain = (exchanged, more) if is_better else ([*others, former], expected_gain)
            unchanged = 0 if is_better else unchanged + 1
    return chosen


def _system(g: Floats, H: Floats, chosen: list[int]) -> tuple[Floats, Floats]:
    """Information (k, k) and gradient (k, 1) of the two columns of each chosen torque."""
    held = [2 * k + part for k in chosen for part in (0, 1)]
    own = H[np.ix_(held, held)]
    return own + np.diag(_ROUNDING * np.diag(own) + _NOTHING), g[held][:, np.newaxis]


def _joint_gain(g: Floats, H: Floats, chosen: list[int]) -> float:
    """Joint expected gain of the chosen torques, nats."""
    own, slope = _system(g, H, chosen)
    return float(0.5 * np.sum(slope * np.linalg.solve(own, slope)))


def _gains_beside(chosen: list[int], g: Floats, H: Floats) -> Floats:
    """Expected gain of adding each of m torques to the chosen ones, nats, shape (m,)."""
    held = [2 * k + part for k in chosen for part in (0, 1)]
    own, slope = _system(g, H, chosen)
    solved = np.linalg.solve(own, np.concatenate([slope, H[held]], axis=1))
    rest_g = g - H[:, held] @ solved[:, 0]
    pairs = np.arange(g.size).reshape(-1, 2)
    shared = solved[:, 1:].T[pairs]
    of_pair = H[pairs[:, :, np.newaxis], pairs[:, np.newaxis]] - H[:, held][pairs] @ shared.transpose(0, 2, 1)
    of_pair += (1e-6 * np.diag(H)[pairs] + _NOTHING)[:, :, np.newaxis] * np.eye(2)
    slopes = rest_g[pairs][:, :, np.newaxis]
    gains: Floats = 0.5 * np.sum(slopes * np.linalg.solve(of_pair, slopes), axis=(1, 2))
    return gains
