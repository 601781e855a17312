"""A simulated recording of the model with disturbance and encoder, along the path of the real one (parametric bootstrap)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import types

from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, JITTER, SENSOR, WHITE
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
_FOLLOWS = 0.5
"""Gain of the α–β filter for position and velocity from the counts (Benedict and Bordner 1962)."""


@njit(types.void(_a, _a, _f8, _f8, _a, _m, _m, _m, _flags, _f8, _m, _f8, _f8, _m, _a, _a))
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
    longest: float,
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
        duration, current, spread: of the parts of each period, as in the filter, shape (n, parts).
        begins: (n,) whether a sample is the first of a stretch.
        longest: longest period in which the additional drive acts [s].
        path: (n, 2) position and velocity to follow.
        stiffness, damping: of an additional drive that moves the shaft to the path. It uses the measured position only:
            otherwise its current would contain information that the counts do not.
        normal: (n, 4) standard normal numbers.
        added: (n,) out: current of that drive in each period [A].
        cell: (n,) out: lower edge of each sample's cell over the resolution.
    """
    n, parts = current.shape
    constant = torque_constant(p)
    state = np.zeros(STATE)
    d = x = v = 0.0
    for i in range(n):
        if begins[i]:
            state[:] = 0.0
            state[THETA] = state[LOAD_THETA] = path[i, 0]
            state[OMEGA] = state[LOAD_OMEGA] = path[i, 1]
            d = noise[DISTURBANCE] * normal[i, 3]
            x, v = path[i, 0], path[i, 1]
        sensor = math.hypot(noise[SENSOR], noise[JITTER] * state[OMEGA])
        shown = measured(p, state[THETA]) + sensor * normal[i, 0]
        cell[i] = math.floor(shown / resolution - edge) + edge
        added[i] = 0.0
        if i + 1 == n or begins[i + 1]:
            continue
        span = time_s[i + 1] - time_s[i]
        off = (cell[i] + 0.5) * resolution - x
        x += _FOLLOWS * off
        v += _FOLLOWS * _FOLLOWS / (2.0 - _FOLLOWS) * off / span
        if span < longest:
            added[i] = (stiffness * (path[i, 0] - x) + damping * (path[i, 1] - v)) / constant
        x += v * span
        kept = math.exp(-span / noise[CORRELATION])
        new = kept * d + noise[DISTURBANCE] * math.sqrt(1.0 - kept * kept) * normal[i, 1]
        white = noise[WHITE] * noise[WHITE] * span
        for j in range(parts):
            white += (constant * spread[i, j] * duration[i, j]) ** 2
        p[_EXTERNAL] = 0.5 * (d + new) + math.sqrt(white) / span * normal[i, 2]
        d = new
        now = time_s[i]
        for j in range(parts):
            if duration[i, j] > 0.0:
                substep(p, state, now, duration[i, j], current[i, j] + added[i])
                now += duration[i, j]
    p[_EXTERNAL] = 0.0
