"""Computation of one tick: dither, force of the spring (`hapticd.servo.law`), excitation, and their current."""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticd.jit import atomic_store, njit
from hapticd.plant.noise import next_uniform
from hapticd.record.schema import FLAG_CLAMPED, FLAG_EXCITATION, FLAG_HELD
from hapticd.servo import atomics, faults
from hapticd.servo._damping import estimate_velocity
from hapticd.servo._passivity import control, observe
from hapticd.servo.dither import periodic
from hapticd.servo.gate import raise_fault
from hapticd.servo.law import soften, spring
from hapticd.servo.layout import (
    DITHER_CURRENT,
    DITHER_NONE,
    HOLD,
    PASSIVITY_OFF,
    UNIFORM,
)


@njit(inline=True, counted=False)
def dither(servo: Any, periods: int) -> float:
    """The dither of this tick, in the unit of its target; the phase advances by ``periods`` servo periods."""
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
def excite(servo: Any, shared: Any, excitation: Any) -> tuple[float, int]:
    """The excitation of this tick: current (A) and displacement of the spring's origin (counts)."""
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
    is_soft = state.held_share >= 0.0
    velocity = estimate_velocity(servo) if params.damping > 0.0 or is_soft else 0.0
    if tick.missed > 0 and params.overrun_policy == HOLD:
        tick.flags |= FLAG_HELD
        return
    extra_current, shift = excite(servo, shared, excitation)
    dither_value = dither(servo, 1 + tick.missed)
    force = spring(params, params, tick.relative - shift, dither_value, velocity)
    if is_soft:
        force = soften(servo, force, shift, dither_value, velocity)
    current = force / params.torque_constant + extra_current
    if params.dither_target == DITHER_CURRENT:
        current += dither_value
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
