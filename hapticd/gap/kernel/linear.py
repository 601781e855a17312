"""Linear recursions along the filter's path: sensitivity of the predictions to torques, and smoothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import from_dtype, types

from hapticd.gap.kernel.ticks import TICK
from hapticd.jit import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")
_rows = types.Array(from_dtype(TICK), 1, "C")


def sensitivities(out: NDArray[Any], columns: NDArray[Any], before: NDArray[Any] | None = None) -> NDArray[Any]:
    """Return d(predicted measurement)/dθ of torques θ_k columns[:, k], by the filter linearised along its path.

    Args:
        out: (n,) of `TICK`.
        columns: (n, K) torque during the period after each sample, N m or N; overwritten.
        before: (3, K) sensitivity of the state to earlier torques of the same laws; changed in place.

    Returns:
        The sensitivities, in the memory of `columns`, rad or m per unit of θ.
    """
    _propagate(out, columns, np.zeros((3, columns.shape[1])) if before is None else before)
    return columns


@njit(types.void(_rows, _m, _m))
def _propagate(out: NDArray[Any], columns: NDArray[Any], state: NDArray[Any]) -> None:
    n, count = columns.shape
    x, v, d = state
    for i in range(n):
        row = out[i]
        known = row.seen * row.share
        gx, gv, gd = row.gain_x * known, row.gain_v * known, row.gain_d * known
        for k in range(count):
            torque = columns[i, k]
            columns[i, k] = row.seen * x[k]
            dx = (1.0 - gx) * x[k]
            dv = v[k] - gv * x[k]
            dd = d[k] - gd * x[k]
            x[k] = dx + row.x_v * dv + row.x_d * dd + row.x_force * torque if row.d_d > 0.0 else 0.0
            v[k] = row.v_v * dv + row.v_d * dd + row.v_force * torque
            d[k] = row.d_d * dd


@njit(_m(_rows, _a))
def smoothed(out: NDArray[Any], white: NDArray[Any]) -> NDArray[Any]:
    """Return velocity and disturbance given all samples (modified Bryson–Frazier smoother).

    Args:
        out: (n,) of `TICK`. white: (n,) variance of the mean white force until the next sample [(N m)² or N²].

    Returns:
        Shape (n, 5): velocity [rad/s or m/s], disturbance torque [N m or N] and its variance, the mean white force until
        the next sample, and the information of the samples on that force.
    """
    n = len(out)
    found = np.empty((n, 5))
    l0 = l1 = l2 = 0.0  # λ̂ and Λ̂ before the sample's own update
    a00 = a01 = a02 = a11 = a12 = a22 = 0.0
    for i in range(n - 1, -1, -1):
        row = out[i]
        found[i, 3] = found[i, 4] = 0.0
        if row.d_d > 0.0:  # through the transition to the next sample: λ̃ = Aᵀ λ̂, Λ̃ = Aᵀ Λ̂ A
            x, v = row.x_force, row.v_force
            found[i, 3] = -white[i] * (x * l0 + v * l1)
            found[i, 4] = x * x * a00 + 2.0 * x * v * a01 + v * v * a11
            xv, vv, xd, vd, dd = row.x_v, row.v_v, row.x_d, row.v_d, row.d_d
            m0, m1, m2 = l0, xv * l0 + vv * l1, xd * l0 + vd * l1 + dd * l2
            b00 = a00
            b01 = xv * a00 + vv * a01
            b02 = xd * a00 + vd * a01 + dd * a02
            c11 = xv * a01 + vv * a11
            c12 = xd * a01 + vd * a11 + dd * a12
            b11 = xv * b01 + vv * c11
            b12 = xv * b02 + vv * c12
            b22 = xd * b02 + vd * c12 + dd * (xd * a02 + vd * a12 + dd * a22)
        else:
            m0 = m1 = m2 = b00 = b01 = b02 = b11 = b12 = b22 = 0.0
        # Through the sample's update: with C = I − K H, λ̂ = Cᵀ λ̃ − Hᵀ S⁻¹ moved, Λ̂ = Cᵀ Λ̃ C + Hᵀ S⁻¹ share H.
        h, share = row.seen, row.share
        k0, k1, k2 = row.gain_x * share, row.gain_v * share, row.gain_d * share
        km = k0 * m0 + k1 * m1 + k2 * m2
        l0, l1, l2 = m0 - h * km - h * row.moved / row.variance, m1, m2
        t0 = k0 * b00 + k1 * b01 + k2 * b02
        t1 = k0 * b01 + k1 * b11 + k2 * b12
        t2 = k0 * b02 + k1 * b12 + k2 * b22
        ktk = k0 * t0 + k1 * t1 + k2 * t2
        a00 = b00 - 2.0 * h * t0 + h * h * ktk + h * h * share / row.variance
        a01, a02 = b01 - h * t1, b02 - h * t2
        a11, a12, a22 = b11, b12, b22
        # The predicted state of this sample is the updated one minus the update.
        g = row.moved
        found[i, 0] = row.v - row.gain_v * g - (row.xv * l0 + row.vv * l1 + row.vd * l2)
        found[i, 1] = row.d - row.gain_d * g - (row.xd * l0 + row.vd * l1 + row.dd * l2)
        p0 = a00 * row.xd + a01 * row.vd + a02 * row.dd
        p1 = a01 * row.xd + a11 * row.vd + a12 * row.dd
        p2 = a02 * row.xd + a12 * row.vd + a22 * row.dd
        found[i, 2] = max(row.dd - (row.xd * p0 + row.vd * p1 + row.dd * p2), 0.0)
    return found
