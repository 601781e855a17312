"""What one tick computes: decimated position, dither, the quantised bidirectional spring (eq. 2), damping, excitation.

    F_V = −K Δ (⌊x/Δ⌋ + ½) − B v,   ⌊x/Δ⌋ = ⌊(raw − origin) / N⌋

with Δ = N raw counts and v as `hapticd.servo.damping` estimates it. The floor of the raw encoder nests,
⌊⌊x/δ⌋/N⌋ = ⌊x/(N δ)⌋, so decimation is exact, also below zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticd.jit import atomic_store, njit
from hapticd.plant.noise import next_uniform
from hapticd.record.schema import FLAG_CLAMPED, FLAG_EXCITATION, FLAG_HELD
from hapticd.servo import atomics, faults
from hapticd.servo.damping import estimate_velocity
from hapticd.servo.dither import periodic
from hapticd.servo.gate import raise_fault
from hapticd.servo.layout import (
    DITHER_CURRENT,
    DITHER_NONE,
    DITHER_POSITION,
    HOLD,
    NEGATIVE_SIDE,
    PASSIVITY_OFF,
    POSITIVE_SIDE,
    UNIFORM,
)
from hapticd.servo.passivity import control, observe


@njit(inline=True, counted=False)
def coarse_ticks(relative: int, decimation: int) -> int:
    """⌊relative / N⌋, towards minus infinity for negative counts too."""
    return relative // decimation


@njit(inline=True, counted=False)
def dither(servo: Any, periods: int) -> float:
    """The dither of this tick, in the unit of its target; the phase moves on by ``periods`` servo periods."""
    params, state = servo.params, servo.state
    if params.dither_target == DITHER_NONE:
        return 0.0
    if state.seed != params.dither_seed:
        state.seed = params.dither_seed
        state.random = params.dither_seed
        state.dither_phase = 0.0
    if params.dither_waveform == UNIFORM:
        state.random, value = next_uniform(state.random)
    else:
        value = periodic(params.dither_waveform, state.dither_phase)
        phase = state.dither_phase + params.dither_frequency * params.period_ns * 1e-9 * periods
        state.dither_phase = phase - np.floor(phase)
    return params.dither_amplitude * value


@njit(inline=True, counted=False)
def spring(
    params: Any, relative: int, dither_value: float, excitation_current: float, velocity: float
) -> tuple[float, float]:
    """Force of the virtual spring and damping (N m or N) and the current that is asked for (A).

    A wall (``side``) ends where it would pull: damping alone never holds the shaft back on its way out.
    """
    if params.dither_target == DITHER_POSITION:
        quantised = np.floor(relative / params.decimation + dither_value)
    else:
        quantised = float(coarse_ticks(relative, params.decimation))
    force = -params.force_per_tick * (quantised + params.bias) - params.damping * velocity
    if (params.side == POSITIVE_SIDE and (quantised < 0.0 or force > 0.0)) or (
        params.side == NEGATIVE_SIDE and (quantised >= 0.0 or force < 0.0)
    ):
        force = 0.0
    current = force / params.torque_constant + excitation_current
    if params.dither_target == DITHER_CURRENT:
        current += dither_value
    return force, current


@njit(inline=True, counted=False)
def excite(servo: Any, shared: Any, excitation: Any) -> tuple[float, int]:
    """What the excitation adds in this tick: current (A) and displacement of the spring's origin (counts)."""
    params, state, tick = servo.params, servo.state, servo.tick
    if state.excitation_id != params.excitation_id:
        state.excitation_id = params.excitation_id
        state.excitation_start = tick.number
    if state.excitation_id == 0:
        return 0.0, 0
    step = tick.number - state.excitation_start
    if step >= params.excitation_length:
        atomic_store(shared, atomics.EXCITATION_DONE, state.excitation_id)
        return 0.0, 0
    tick.flags |= FLAG_EXCITATION
    return excitation[0, step], int(excitation[1, step])


@njit(inline=True, counted=False)
def render(servo: Any, shared: Any, excitation: Any) -> None:
    """Force and clamped current of this tick; a current that is not finite is a fault."""
    params, state, tick = servo.params, servo.state, servo.tick
    if params.passivity != PASSIVITY_OFF:
        observe(servo)
    velocity = estimate_velocity(servo) if params.damping > 0.0 else 0.0
    if tick.missed > 0 and params.overrun_policy == HOLD:
        tick.flags |= FLAG_HELD
        return
    extra_current, shift = excite(servo, shared, excitation)
    dither_value = dither(servo, 1 + tick.missed)
    force, current = spring(params, tick.relative - shift, dither_value, extra_current, velocity)
    if not np.isfinite(current):
        raise_fault(servo, shared, faults.NON_FINITE, current, 0.0)
        return
    if params.safety and abs(current) > params.peak_current:
        current = np.copysign(params.peak_current, current)
        shared[atomics.CLAMPED] += 1
        tick.flags |= FLAG_CLAMPED
    if params.passivity != PASSIVITY_OFF:
        rendered = current
        current = control(servo, rendered, params.peak_current if params.safety else np.inf)
        force += (current - rendered) * params.torque_constant
    state.force = force
    state.requested = current
