"""What one tick computes: decimated position, dither, the quantised bidirectional spring (eq. 2), excitation, DAC grid.

    F_V = −K Δ (⌊x/Δ⌋ + ½),   ⌊x/Δ⌋ = ⌊(raw − origin) / N⌋

with Δ = N raw counts. The floor of the raw encoder nests, ⌊⌊x/δ⌋/N⌋ = ⌊x/(N δ)⌋, so decimation is exact, also below zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant.noise import next_uniform
from hapticd.servo.dither import periodic
from hapticd.servo.layout import (
    DITHER_CURRENT,
    DITHER_NONE,
    DITHER_POSITION,
    P_BIAS,
    P_DECIMATION,
    P_DITHER_AMPLITUDE,
    P_DITHER_FREQUENCY,
    P_DITHER_SEED,
    P_DITHER_TARGET,
    P_DITHER_WAVEFORM,
    P_FORCE_PER_TICK,
    P_PERIOD_NS,
    P_SIDE,
    P_TORQUE_CONSTANT,
    UNIFORM,
    V_DITHER_PHASE,
    W_RANDOM,
    W_SEED,
)


@njit("int64(int64, int64)", inline=True, counted=False)
def coarse_ticks(relative: int, decimation: int) -> int:
    """⌊relative / N⌋, towards minus infinity for negative counts too."""
    return relative // decimation


@njit("float64(float64[::1], int64[::1], float64[::1], int64)", inline=True, counted=False)
def dither(params: NDArray[Any], ints: NDArray[Any], floats: NDArray[Any], periods: int) -> float:
    """The dither of this tick, in the unit of its target; the phase moves on by ``periods`` servo periods."""
    if params[P_DITHER_TARGET] == DITHER_NONE:
        return 0.0
    seed = int(params[P_DITHER_SEED])
    if ints[W_SEED] != seed:
        ints[W_SEED] = seed
        ints[W_RANDOM] = seed
        floats[V_DITHER_PHASE] = 0.0
    waveform = int(params[P_DITHER_WAVEFORM])
    if waveform == UNIFORM:
        ints[W_RANDOM], value = next_uniform(ints[W_RANDOM])
    else:
        value = periodic(waveform, floats[V_DITHER_PHASE])
        phase = floats[V_DITHER_PHASE] + params[P_DITHER_FREQUENCY] * params[P_PERIOD_NS] * 1e-9 * periods
        floats[V_DITHER_PHASE] = phase - np.floor(phase)
    return params[P_DITHER_AMPLITUDE] * value


@njit("Tuple((float64, float64))(float64[::1], int64, float64, float64)", inline=True, counted=False)
def spring(params: NDArray[Any], relative: int, dither_value: float, excitation_current: float) -> tuple[float, float]:
    """Force of the virtual spring (N m or N) and the current that is asked for (A)."""
    decimation = int(params[P_DECIMATION])
    if params[P_DITHER_TARGET] == DITHER_POSITION:
        quantised = np.floor(relative / decimation + dither_value)
    else:
        quantised = float(coarse_ticks(relative, decimation))
    force = -params[P_FORCE_PER_TICK] * (quantised + params[P_BIAS])
    if (params[P_SIDE] > 0.0 and quantised < 0.0) or (params[P_SIDE] < 0.0 and quantised >= 0.0):
        force = 0.0
    current = force / params[P_TORQUE_CONSTANT] + excitation_current
    if params[P_DITHER_TARGET] == DITHER_CURRENT:
        current += dither_value
    return force, current
