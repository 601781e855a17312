"""What the filter knows of the load behind a play: its covariance with the shaft's state, and its own.

In contact the load is where the shaft is. Where they part it takes the shaft's uncertainty along, coasts, and gives it
back at the next impact: whatever the counts tell of the shaft meanwhile tells of the load too.

The quadrature moves the load along w with the shaft. What is left across w is carried linearly: over a time T a coasting
load obeys l′ = l + T·l̇, and an impact takes J = (1 + e)·σ of the relative motion from the shaft and gives
K = (1 + e)·(1 − σ) of it to the load, σ the load's part of the inertia and e the restitution; when it happens within the
period matters to neither position nor velocity at its end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.jit import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")
_weights = types.Array(_f8, 1, "C", readonly=True)


@njit(types.void(_m, _m, _f8, _f8, _f8, _f8, _f8), counted=False)
def tie(C: NDArray[Any], P: NDArray[Any], xx: float, xv: float, xd: float, vv: float, vd: float) -> None:
    """The load is in contact: its position and velocity vary with the shaft's.

    Args:
        C: covariance of the load's position and velocity with the shaft's state (x, v, d), shape (2, 3).
        P: covariance of the load's position and velocity, shape (2, 2).
        xx, xv, xd, vv, vd: covariance of the shaft's state.
    """
    C[0, 0], C[0, 1], C[0, 2] = xx, xv, xd
    C[1, 0], C[1, 1], C[1, 2] = xv, vv, vd
    P[0, 0], P[0, 1], P[1, 0], P[1, 1] = xx, xv, xv, vv


@njit(types.UniTuple(_f8, 2)(_m, _m, _f8, _f8, _f8, _f8, _f8, _f8), counted=False)
def see(
    C: NDArray[Any], P: NDArray[Any], seen: float, variance: float, share: float, gx: float, gv: float, gd: float
) -> tuple[float, float]:
    """Take what a count tells; return the regression of the load's position and velocity on the measurement.

    Args:
        C, P: as for `tie`, changed in place.
        seen: d measurement / d x. variance: of the measurement. share: of it that the count takes away.
        gx, gv, gd: regression of the shaft's state on the measurement.
    """
    lx, lv = seen * C[0, 0] / variance, seen * C[1, 0] / variance
    taken = variance * share
    for row, g in ((0, lx), (1, lv)):
        C[row, 0] -= g * gx * taken
        C[row, 1] -= g * gv * taken
        C[row, 2] -= g * gd * taken
        P[row, 0] -= g * lx * taken
        P[row, 1] -= g * lv * taken
    return lx, lv


@njit(types.UniTuple(_f8, 5)(_m, _m, _a, _a, _f8, _f8, _f8, _f8, _f8, _f8), counted=False)
def carry(
    C: NDArray[Any],
    P: NDArray[Any],
    along: NDArray[Any],
    across: NDArray[Any],
    ww: float,
    period: float,
    decay: float,
    half: float,
    J: float,
    K: float,
) -> tuple[float, float, float, float, float]:
    """Carry over a period what w does not tell of the load; return what an impact adds to the shaft's covariance.

    Args:
        C, P: as for `tie`; all of it before, what is left across w after.
        along: regression of x, v, d and the load's position and velocity on w, shape (5,).
        across: covariance xx, xv, xd, vv, vd of the shaft's state given w, shape (5,).
        ww: variance of w.
        period: T [s].
        decay: of the disturbance in it.
        half: d (x at its end) / d v, across w [s].
        J, K: of the impact in it; 0 without one.

    Returns:
        What is added to xx, xv, xd, vv and vd.
    """
    for row in range(2):
        for column in range(3):
            C[row, column] -= along[3 + row] * along[column] * ww
        for column in range(2):
            P[row, column] -= along[3 + row] * along[3 + column] * ww
    # Without an impact: f of the shaft's position, g of the load's, h of the load's velocity, d of the disturbance.
    ff = across[0] + half * (2.0 * across[1] + half * across[3])
    fd = decay * (across[2] + half * across[4])
    fg = C[0, 0] + period * C[1, 0] + half * (C[0, 1] + period * C[1, 1])
    fh = C[1, 0] + half * C[1, 1]
    gg = P[0, 0] + period * (2.0 * P[0, 1] + period * P[1, 1])
    gh, hh = P[0, 1] + period * P[1, 1], P[1, 1]
    gd, hd = decay * (C[0, 2] + period * C[1, 2]), decay * C[1, 2]
    j, k = 1.0 - J, 1.0 - K
    C[0, 0] = k * (j * fg + J * gg) + K * (j * ff + J * fg)
    C[0, 1] = J * (k * gh + K * fh)
    C[0, 2] = k * gd + K * fd
    C[1, 0], C[1, 1], C[1, 2] = k * (j * fh + J * gh), k * J * hh, k * hd
    P[0, 0] = k * k * gg + 2.0 * k * K * fg + K * K * ff
    P[0, 1] = k * (k * gh + K * fh)
    P[1, 0], P[1, 1] = P[0, 1], k * k * hh
    return (
        (j * j - 1.0) * ff + 2.0 * j * J * fg + J * J * gg,
        J * (j * fh + J * gh),
        J * (gd - fd),
        J * J * hh,
        J * hd,
    )


@njit(types.void(_m, _m, _weights, _a, _a, _a, _a, _a, _f8, _f8, _f8, _f8, _f8), counted=False)
def spread_along(
    C: NDArray[Any],
    P: NDArray[Any],
    weights: NDArray[Any],
    xs: NDArray[Any],
    vs: NDArray[Any],
    ds: NDArray[Any],
    load_xs: NDArray[Any],
    load_vs: NDArray[Any],
    x: float,
    v: float,
    d: float,
    load_x: float,
    load_v: float,
) -> None:
    """Add to `C` and `P` how the points along w vary together: arrays of shape (points,), and their means."""
    for k in range(len(weights)):
        far, fast = weights[k] * (load_xs[k] - load_x), weights[k] * (load_vs[k] - load_v)
        C[0, 0] += far * (xs[k] - x)
        C[0, 1] += far * (vs[k] - v)
        C[0, 2] += far * (ds[k] - d)
        C[1, 0] += fast * (xs[k] - x)
        C[1, 1] += fast * (vs[k] - v)
        C[1, 2] += fast * (ds[k] - d)
        P[0, 0] += far * (load_xs[k] - load_x)
        P[0, 1] += far * (load_vs[k] - load_v)
        P[1, 1] += fast * (load_vs[k] - load_v)
    P[1, 0] = P[0, 1]
