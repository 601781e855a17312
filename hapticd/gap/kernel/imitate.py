"""A recording as the model itself would make it, disturbance, encoder and all, along the path of the real one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import types

from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, SENSOR, WHITE
from hapticd.jit import njit
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.layout import LOAD_OMEGA, LOAD_THETA, OMEGA, STATE, THETA, index_of
from hapticd.plant.numeric import measured, substep

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")
_flags = types.Array(types.boolean, 1, "C")

_EXTERNAL = index_of("external_force")


@njit(types.void(_a, _a, _f8, _f8, _a, _m, _m, _m, _flags, _m, _f8, _f8, _m, _a, _a))
def imitate(
    p: NDArray[Any],
    noise: NDArray[Any],
    resolution: float,
    edge: float,
    time_s: NDArray[Any],
    duration: NDArray[Any],
    current: NDArray[Any],
    spread: NDArray[Any],
    begins: NDArray[Any],
    path: NDArray[Any],
    stiffness: float,
    damping: float,
    normal: NDArray[Any],
    added: NDArray[Any],
    cell: NDArray[Any],
) -> None:
    """Move the model's shaft near a path, and read its encoder.

    Args:
        p: device vector, shape (SIZE,); its external force is used as scratch.
        noise: shape (5,), in the order of `NOISE`.
        resolution: width of a cell [rad or m]. edge: of a cell, over the resolution.
        time_s: (n,) instants [s].
        duration, current, spread: of the parts of each period, as the filter takes them, shape (n, parts).
        begins: (n,) whether a sample is the first of a stretch.
        path: (n, 2) position and velocity to follow.
        stiffness, damping: of a drive besides, that pulls the shaft to the path.
        normal: (n, 4) standard normal numbers.
        added: (n,) out: current of that drive in each period [A].
        cell: (n,) out: lower edge of each sample's cell over the resolution.
    """
    n, parts = current.shape
    constant = torque_constant(p)
    state = np.zeros(STATE)
    d = 0.0
    for i in range(n):
        if begins[i]:
            state[:] = 0.0
            state[THETA] = state[LOAD_THETA] = path[i, 0]
            state[OMEGA] = state[LOAD_OMEGA] = path[i, 1]
            d = noise[DISTURBANCE] * normal[i, 3]
        shown = measured(p, state[THETA]) + noise[SENSOR] * normal[i, 0]
        cell[i] = math.floor(shown / resolution - edge) + edge
        added[i] = 0.0
        if i + 1 == n or begins[i + 1]:
            continue
        added[i] = (stiffness * (path[i, 0] - state[THETA]) + damping * (path[i, 1] - state[OMEGA])) / constant
        span = time_s[i + 1] - time_s[i]
        kept = math.exp(-span / noise[CORRELATION])
        new = kept * d + noise[DISTURBANCE] * math.sqrt(1.0 - kept * kept) * normal[i, 1]
        p[_EXTERNAL] = 0.5 * (d + new) + (noise[WHITE] / math.sqrt(span) + constant * spread[i, 0]) * normal[i, 2]
        d = new
        now = time_s[i]
        for j in range(parts):
            if duration[i, j] > 0.0:
                substep(p, state, now, duration[i, j], current[i, j] + added[i])
                now += duration[i, j]
    p[_EXTERNAL] = 0.0
