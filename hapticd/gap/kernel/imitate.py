"""A simulated recording of the model with disturbance and encoder, along the path of the real one (parametric bootstrap)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from hapticd.gap.kernel.samples import SAMPLES, Samples
from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, JITTER, SENSOR, WHITE
from hapticd.jit import njit
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.layout import LOAD_OMEGA, LOAD_THETA, OMEGA, STATE, THETA, index_of
from hapticd.plant.numeric import measured, substep

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")

_EXTERNAL = index_of("external_force")
_FOLLOWS = 0.5
"""Gain of the α–β filter for position and velocity from the counts (Benedict and Bordner 1962)."""


class Drive(NamedTuple):
    """An additional drive that moves the shaft along a path.

    It uses the measured position only: otherwise its current would contain information that the counts do not.

    Attributes:
        path: (n, 2) position and velocity to follow.
        stiffness, damping: of the drive.
        longest: longest period in which it acts [s].
    """

    path: NDArray[Any]
    stiffness: float
    damping: float
    longest: float


_DRIVE = types.NamedTuple((_m, _f8, _f8, _f8), Drive)


@njit(types.void(_a, _a, SAMPLES, _DRIVE, _m, _a))
def imitate(
    p: NDArray[Any],
    noise: NDArray[Any],
    samples: Samples,
    drive: Drive,
    normal: NDArray[Any],
    added: NDArray[Any],
) -> None:
    """Move the model's shaft near a path, and read its encoder.

    Args:
        p: device vector, shape (SIZE,); its external force is used as scratch.
        noise: shape (5,), in the order of `NOISE`.
        samples: as in the filter; their cells are replaced by those of the model, with the same edges.
        drive: what keeps the shaft near the path.
        normal: (n, 4) standard normal numbers.
        added: (n,) out: current of that drive in each period [A].
    """
    resolution, time_s, cell, begins = samples.resolution, samples.time_s, samples.cell, samples.begins
    duration, current, spread = samples.duration, samples.current, samples.spread
    path, stiffness, damping, longest = drive.path, drive.stiffness, drive.damping, drive.longest
    edge = cell[0] % 1.0
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
