"""The stochastic filter of the workflow: the probability of each encoder count, given those before it.

State: position x, velocity v, and a disturbance torque d that no law explains,

    dx = v dt,   m dv = (K_t i + f_θ(x, v, i, t) + d) dt + σ dW,   dd = −d/τ dt + s √(2/τ) dW′,   count = ⌊(h(x) + r e)/Δ⌋.

Near standstill friction holds the shaft, or it moves up or down: three modes, each a normal distribution of the state
with its probability (`hapticd.gap.kernel.modes`; Gaussian sum: Alspach and Sorenson, IEEE TAC 17, 1972). The next mode
depends on the velocity that the shaft would have after a period T if only d acted, without friction and the other forces,

    w = v + (T/m) d + noise.

With the sum F of the other forces and a stiction c the shaft moves up if w > (c − F) T/m, down if w < (−c − F) T/m, and is
at rest in between. Each mode is divided at these two limits; pieces with the same next mode are merged, and the exact plant
(`hapticd.plant.numeric.substep`) moves their mean, so that the filter contains every law of the catalogue; the covariance is
propagated linearly; and the pieces of each new mode are merged again. The load behind a play or a coupling is part of the
state; a bristle is a function of the shaft's path.

The measurement is the probability of the encoder's cell, its update the moments of the normal distribution truncated to it
(grey-box identification: Kristensen, Madsen and Jørgensen, Automatica 40, 2004; latent force: Rogers and Friis,
arXiv 2109.10681).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from hapticd.gap.kernel.carry import carry, cut
from hapticd.gap.kernel.device import LAWS, PERIOD, couple, look_up, loosen, moving_inertia
from hapticd.gap.kernel.modes import MODE, STATES, UP, join, see, tie
from hapticd.gap.kernel.samples import SAMPLES, Samples
from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, JITTER, SENSOR, TICK, WHITE
from hapticd.jit import njit
from hapticd.plant.exact import phi_functions
from hapticd.plant.layout import STATE, index_of

_EXTERNAL, _GAP = index_of("external_force"), index_of("backlash.gap")

SAME_SPAN = 1e-9
"""Relative difference of two periods due to rounding of time stamps."""

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_rows = types.Array(from_dtype(TICK), 1, "C")
_laws, _periods = types.Array(from_dtype(LAWS), 1, "C"), types.Array(from_dtype(PERIOD), 1, "C")
_modes = types.Array(from_dtype(MODE), 1, "C")


class Scratch(NamedTuple):
    """Memory of `_filter`, whose allocation takes a tenth of the time."""

    laws: NDArray[Any]
    periods: NDArray[Any]
    modes: NDArray[Any]
    groups: NDArray[Any]
    state: NDArray[Any]
    other: NDArray[Any]


_SCRATCH = types.NamedTuple((_laws, _periods, _modes, _modes, _a, _a), Scratch)


@njit(_f8(_a, _a, SAMPLES, _rows, _SCRATCH), counted=False)
def _filter(p: NDArray[Any], noise: NDArray[Any], samples: Samples, out: NDArray[Any], scratch: Scratch) -> float:
    """`run_filter` in given memory."""
    resolution, time_s, cell, begins = samples.resolution, samples.time_s, samples.cell, samples.begins
    duration, current, spread = samples.duration, samples.current, samples.spread
    laws, periods, modes, groups = scratch.laws, scratch.periods, scratch.modes, scratch.groups
    state, other = scratch.state, scratch.other
    n, parts = current.shape
    sensor, tau = noise[SENSOR], noise[CORRELATION]
    power = noise[DISTURBANCE] * noise[DISTURBANCE]
    p[_EXTERNAL] = 0.0
    law, period = laws[0], periods[0]
    look_up(p, current, law)
    total = 0.0
    for i in range(n):
        if begins[i]:
            last = min(i + 5, n - 1)
            for k in range(i + 1, last + 1):
                if begins[k]:
                    last = k - 1
                    break
            span = time_s[last] - time_s[i] if last > i else 1.0
            for k in range(3):
                modes[k].weight = 0.0
            m = modes[UP]  # the first period determines the mode
            m.weight = 1.0
            m.bristle = m.bristle_x = m.contact = 0.0
            m.covariance[:] = 0.0
            m.mean[0] = m.mean[4] = (cell[i] + 0.5) * resolution
            m.mean[1] = m.mean[5] = (cell[last] - cell[i]) * resolution / span
            m.mean[2] = 0.0
            m.covariance[0, 0] = resolution * resolution + sensor * sensor
            m.covariance[1, 1] = (
                (2.0 * resolution / span) ** 2 + m.mean[1] ** 2 + (span * law.coulomb / law.inertia) ** 2
            )
            m.covariance[2, 2] = power
            if law.has_play:
                tie(m)
                m.covariance[4, 4] += p[_GAP] * p[_GAP] / 12.0
            if law.has_coupling:
                loosen(law, m)
        total += see(p, modes, cell[i], resolution, sensor, noise[JITTER], law.size, out, i)
        row = out[i]
        if i + 1 == n or begins[i + 1]:
            row.next_v = row.v
            row.x_v = row.v_v = row.x_d = row.v_d = row.d_d = row.x_force = row.v_force = 0.0
            continue
        period.time, span = time_s[i], time_s[i + 1] - time_s[i]
        if abs(span - period.span) > SAME_SPAN * span:
            period.span = span
            ratio = span / tau
            period.decay, period.mean, way = phi_functions(-ratio)
            period.coloured = 2.0 * power * span * span * (way - 0.5 * period.mean * period.mean)
            period.fresh = power * span * period.mean * (1.0 - period.decay)
            period.renewed = power * (1.0 - period.decay * period.decay)
            period.coast = math.exp(-law.viscous * span / law.inertia)
            if law.has_coupling:
                couple(p, law, period)
        period.white = noise[WHITE] * noise[WHITE] * span
        for j in range(parts):
            period.white += (law.torque_constant * spread[i, j] * duration[i, j]) ** 2
        period.slide = period.moves = 0.0
        likeliest = 0
        for k in range(4):
            groups[k].weight = 0.0
        for mode in range(3):
            if modes[mode].weight > 0.0:
                cut(p, laws, periods, duration[i], current[i], modes, mode, groups)
                if modes[mode].weight > modes[likeliest].weight:
                    likeliest = mode
        unit = span / (moving_inertia(p, modes[likeliest].contact) if law.size == STATES else law.inertia)
        whole = 0.0
        for k in range(4):
            whole += groups[k].weight
        if not whole > 0.0:
            return math.nan  # a parameter of the device is NaN
        for mode in range(3):
            modes[mode].weight = 0.0
        for k in range(4):
            if groups[k].weight > 0.0:
                groups[k].weight /= whole
                ends = carry(p, laws, periods, duration[i], current[i], groups, k, state, other)
                join(modes[ends], groups[k], groups[k].weight, 0.0, 0.0, law.size)
        row.next_v = 0.0
        for mode in range(3):
            row.next_v += modes[mode].weight * modes[mode].mean[1] if modes[mode].weight > 0.0 else 0.0
        slide, half = period.slide, 0.5 * span
        row.v_v, row.v_d, row.d_d, row.v_force = slide, period.mean * unit * slide, period.decay, unit * slide
        row.x_v, row.x_d, row.x_force = half * (period.moves + slide), half * row.v_d, half * row.v_force
    return total


def run_filter(p: NDArray[Any], noise: NDArray[Any], samples: Samples, out: NDArray[Any]) -> float:
    """Filter recordings and return the log-likelihood.

    Args:
        p: device vector, shape (SIZE,); its external force is used as scratch.
        noise: shape (5,), in the order of `NOISE`.
        samples: n of them.
        out: shape (n,) of `TICK`.
    """
    scratch = Scratch(
        np.zeros(1, LAWS), np.zeros(1, PERIOD), np.zeros(3, MODE), np.zeros(4, MODE), np.zeros(STATE), np.zeros(STATE)
    )
    return float(_filter(p, noise, samples, out, scratch))
