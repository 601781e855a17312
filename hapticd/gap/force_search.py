"""Nonlinear parameters that a grid is too coarse for: the orders of a ripple, the interval of a grip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.regression import solve

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.balance import Balance

    FloatArray = NDArray[np.float64]

_MOST_ORDERS = 8
_FALSE_ORDER = 0.005


def ripple_orders(
    balance: Balance, fixed: FloatArray, rows: NDArray[np.bool_], most: int = _MOST_ORDERS
) -> list[float]:
    """Orders per revolution, strongest first: the peaks of the residual's periodogram over angle, one after the other.

    After each order the residual is fitted anew with all orders so far (orthogonal matching pursuit, Pati et al. 1993).
    Without a ripple, the sums of the wave over short pieces of the record add up with random phases, and the power is
    exponentially distributed; an order whose power the largest of all orders would reach by chance ends the search. The
    first one is always given.
    """
    grid = balance.grid("torque_ripple")
    target, angle = balance.target[rows], balance.position()[rows]
    waves = np.exp(-1j * np.outer(grid, angle))
    piece = balance.pieces[rows]
    orders: list[float] = []
    design = np.column_stack([fixed, np.ones(fixed.shape[0])])[rows]
    while len(orders) < most:
        residual = target - design @ solve(design, target)
        terms = waves * residual
        sums = np.stack([np.bincount(piece, wave.real) + 1j * np.bincount(piece, wave.imag) for wave in terms])
        chance = np.sum(np.abs(sums) ** 2, axis=1) * np.log(grid.size / _FALSE_ORDER)
        power = np.abs(terms.sum(axis=1)) ** 2
        peak = int(np.argmax(np.where(np.isin(grid, orders), 0.0, power)))
        if orders and power[peak] < chance[peak]:
            break
        orders.append(float(grid[peak]))
        design = np.column_stack([design, *(c[rows] for c in balance.columns("torque_ripple", orders[-1]).values())])
    return orders


def grip_interval(
    balance: Balance, fixed: FloatArray, rows: NDArray[np.bool_]
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Part of the record in which a hand's inertia, damping and stiffness explain ``rows`` best.

    Filtering is linear, so the columns of an interval are the sums of those of its segments. The whole record is not
    asked: a grip that neither begins nor ends is a return spring, and errors of inertia and viscous friction.

    Returns:
        ``t_on`` and ``t_off`` in s from the beginning, on the edges of the segments, and the columns (m,).
    """
    edges = balance.grid("hand_impedance")
    segments = [balance.columns("hand_impedance", segment) for segment in range(edges.size - 1)]
    names = tuple(segments[0])
    stacked = np.stack([np.column_stack([segment[name] for name in names]) for segment in segments])
    upto = np.concatenate([np.zeros_like(stacked[:1]), np.cumsum(stacked, axis=0)])
    best, least = (0, 1), np.inf
    for first in range(edges.size - 1):
        for last in range(first + 1, edges.size):
            if last - first == edges.size - 1:
                continue
            design = np.column_stack([fixed, upto[last] - upto[first]])[rows]
            residual = balance.target[rows] - design @ solve(design, balance.target[rows])
            left = float(residual @ residual)
            best, least = ((first, last), left) if left < least else (best, least)
    columns = upto[best[1]] - upto[best[0]]
    interval = {"t_on": float(edges[best[0]]), "t_off": float(edges[best[1]])}
    return interval, {name: columns[:, index] for index, name in enumerate(names)}
