"""Effects periodic in the shaft's position: a torque (ripple) or an error of the measurement (eccentricity)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.candidates.build import Scalar
from hapticd.gap.fit import fit
from hapticd.gap.hypothesis import Coordinate, Term
from hapticd.plant.layout import word

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from hapticd.gap.context import Context

    Floats = NDArray[np.float64]

_HIGHEST_ORDER = 240
_LINEAR_ORDERS = 240
_CELLS_PER_PERIOD = 12
_SIGNIFICANT = 30.0
"""Gain that an order needs, in units of the residual's variance: 2 ln 240 is what the best of pure noise reaches."""
_SHARE = 0.02
"""Orders that explain less than this share of the first one's gain are as likely to mend what the linear response of
the first ones gets wrong."""
_SERIES = 4
"""Orders in a row from among the lowest that make a series."""
_LOOK = 6
"""Iterations of the fit that says which orders are needed."""


def orders_to_try(context: Context) -> Floats:
    """Orders per revolution (integers), or angular wave numbers [rad/m] of a linear device, that the encoder resolves."""
    if context.is_linear:
        lowest = np.pi / max(context.span, context.resolution)
        highest = min(2.0 * np.pi / (_CELLS_PER_PERIOD * context.resolution), lowest * _LINEAR_ORDERS)
        return np.arange(lowest, highest, lowest)
    highest = min(_HIGHEST_ORDER, int(2.0 * np.pi / context.resolution / _CELLS_PER_PERIOD))
    lowest = 1 if context.span > np.pi / 2.0 else int(np.ceil(np.pi / max(context.span, 1e-9)))
    return np.arange(lowest, highest + 1, dtype=np.float64)


def _chosen_orders(context: Context, orders: Floats, limit: int) -> tuple[list[int], Floats]:
    """Orthogonal matching pursuit over sine and cosine torques; indices of orders and their 2·k amplitudes."""
    gram, right, scale = context.normal_of_harmonics(orders)
    chosen: list[int] = []
    amplitudes: Floats = np.zeros(0)
    first = 0.0
    remaining = right.copy()
    while len(chosen) < limit:
        gains = np.zeros(len(orders))
        taken = [2 * k + part for k in chosen for part in (0, 1)]
        for k in range(len(orders)):
            if any(abs(orders[k] - orders[other]) < context.order_resolution for other in chosen):
                continue
            pair = [2 * k, 2 * k + 1]
            own = gram[np.ix_(pair, pair)]
            if taken:
                cross = gram[np.ix_(taken, pair)]
                own = own - cross.T @ np.linalg.solve(gram[np.ix_(taken, taken)], cross)
            if np.linalg.det(own) > 1e-9 * own[0, 0] * own[1, 1] > 0.0:
                gains[k] = remaining[pair] @ np.linalg.solve(own, remaining[pair]) / scale
        best = int(np.argmax(gains))
        first = first or float(gains[best])
        if gains[best] < max(_SIGNIFICANT, _SHARE * first):
            break
        chosen.append(best)
        taken = [2 * k + part for k in chosen for part in (0, 1)]
        amplitudes = np.asarray(np.linalg.solve(gram[np.ix_(taken, taken)], right[taken]), dtype=np.float64)
        remaining = right - gram[:, taken] @ amplitudes
    return chosen, amplitudes


def _is_gravity(context: Context, orders: Floats, amplitudes: Floats) -> bool:
    """Whether the largest of the amplitudes (2k,) is that of once per revolution, which is the law of gravity."""
    return not context.is_linear and float(orders[np.argmax(np.hypot(amplitudes[0::2], amplitudes[1::2]))]) == 1.0


def torque_ripple(context: Context) -> list[Term]:
    """+ Σ a_k·sin(kθ + φ_k), with the orders found in the residual's response to harmonic torques."""
    length = next(p.length for p in CATALOGUE["torque_ripple"].parameters if p.name == "orders")
    orders = orders_to_try(context)
    chosen, amplitudes = _chosen_orders(context, orders, length) if len(orders) else ([], np.zeros(0))
    if not chosen or _is_gravity(context, orders[chosen], amplitudes):
        return []
    term = _needed(context, _ripple(context, orders, orders[chosen], amplitudes), orders)
    found = np.array(term.form["orders"])
    if _is_gravity(context, found, np.array(term.start)) or _is_series(np.searchsorted(orders, found)):
        return []
    return [term]


def _is_series(places: NDArray[np.int64]) -> bool:
    """Whether orders are the first terms of a Fourier series: some other function of the position, not a ripple.

    Args:
        places: in the list of orders (k,).
    """
    lowest = np.sort(places)[:_SERIES]
    return len(lowest) == _SERIES and bool(lowest[0] < _SERIES - 1 and np.all(np.diff(lowest) == 1))


def _needed(context: Context, term: Term, orders: Floats) -> Term:
    """The ripple with those of its orders that whole predictions of a third of the windows need.

    The linear response of a strong ripple asks for orders that are not there.
    """
    known, few = context.fit.solution, context.few
    present = known.hypothesis.held(known.u, len(known.hypothesis.terms))
    fitted = fit(few.segments, present.with_term(term), np.array(term.start), few.states, _LOOK)
    value = fitted.solution.u
    inverse = np.linalg.pinv(fitted.at.hessian.sum(axis=0), hermitian=True)
    pairs = [slice(2 * k, 2 * k + 2) for k in range(len(value) // 2)]
    gains = np.array(
        [value[pair] @ np.linalg.pinv(inverse[pair, pair], hermitian=True) @ value[pair] for pair in pairs]
    )
    keep = gains >= max(_SIGNIFICANT / 3.0, _SHARE * float(gains.max()))
    found = np.array(term.form["orders"])
    if not keep.any():
        return term
    return _ripple(context, orders, found[keep], value.reshape(-1, 2)[keep].ravel())


def _ripple(context: Context, orders: Floats, chosen: Floats, amplitudes: Floats) -> Term:
    """The effect with given orders (k,), of those tried, starting from sine and cosine amplitudes (2k,)."""
    found = [float(order) for order in chosen]
    first = {name: word(f"torque_ripple.{name}[0]") for name in ("orders", "amplitudes", "phases")}

    def parameters(u: Floats) -> dict[str, float]:
        result = {}
        for k, order in enumerate(found):
            result[f"orders[{k}]"] = order
            result[f"amplitudes[{k}]"] = float(np.hypot(u[2 * k], u[2 * k + 1]))
            result[f"phases[{k}]"] = float(np.arctan2(u[2 * k + 1], u[2 * k]))
        return result

    def write(vector: Floats, u: Floats) -> None:
        count = len(found)
        vector[first["orders"] : first["orders"] + count] = found
        vector[first["amplitudes"] : first["amplitudes"] + count] = np.hypot(u[0::2], u[1::2])
        vector[first["phases"] : first["phases"] + count] = np.arctan2(u[1::2], u[0::2])

    def entry(u: Floats) -> Mapping[str, object]:
        return {
            "orders": found,
            "amplitudes": [float(a) for a in np.hypot(u[0::2], u[1::2])],
            "phases": [float(a) for a in np.arctan2(u[1::2], u[0::2])],
        }

    limit = 10.0 * context.force_scale
    coordinates = tuple(
        Coordinate(f"{part}_{order:g}", -limit, limit, 1e-3 * limit) for order in found for part in ("sine", "cosine")
    )
    start = tuple(float(np.clip(a, -limit, limit)) for a in amplitudes)
    return Term(
        "torque_ripple",
        coordinates,
        write,
        parameters,
        start,
        float(len(orders)),
        entry=entry,
        form={"orders": found, **_between_orders(context, orders, len(found))},
    )


def _between_orders(context: Context, orders: Floats, count: int) -> Mapping[str, float]:
    """How far an order may be from those tried: not at all per revolution, half a step of the grid along a line."""
    if not context.is_linear or len(orders) < 2:
        return {}
    return {f"orders[{k}]_standard_error": float((orders[1] - orders[0]) / np.sqrt(12.0)) for k in range(count)}


def encoder_eccentricity(context: Context) -> list[Term]:
    """Measured θ + e·sin(θ + φ), fitted as sine and cosine amplitudes."""
    if context.is_linear:
        return []
    size, phase = word("encoder_eccentricity.e"), word("encoder_eccentricity.phi")
    scalar = Scalar("e", 0.0, 0.0, 0.5)

    def parameters(u: Floats) -> dict[str, float]:
        return {"e": float(np.hypot(u[0], u[1])), "phi": float(np.arctan2(u[1], u[0]))}

    def write(vector: Floats, u: Floats) -> None:
        vector[size], vector[phase] = parameters(u).values()

    coordinates = tuple(
        Coordinate(name, -scalar.upper, scalar.upper, 0.3 * context.resolution) for name in ("sine", "cosine")
    )
    return [Term("encoder_eccentricity", coordinates, write, parameters, (0.0, 0.0))]
