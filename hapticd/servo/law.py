"""The law of the rendered spring, and the transition from one to the next.

    F_V = −K Δ (⌊x/Δ⌋ + ½) − B v,   ⌊x/Δ⌋ = ⌊(raw − origin) / N⌋                (eq. 2)
    F   = s F_V + (1 − s) F_held,   s from 0 to 1 over `safety.soft_start_s`

with Δ = N raw counts and v estimated by `hapticd.servo._damping`. The floor functions of encoder and decimation combine,
⌊⌊x/δ⌋/N⌋ = ⌊x/(N δ)⌋, so decimation is exact, also below zero. F_held is 0 when running begins, and the previous spring
after a change: `docs/decisions/0071-soft-start.md`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticd.jit import njit
from hapticd.servo.layout import DITHER_POSITION, NEGATIVE_SIDE, NO_RAMP, POSITIVE_SIDE, RUNNING


@njit(inline=True, counted=False)
def coarse_ticks(relative: int, decimation: int) -> int:
    """⌊relative / N⌋, rounded towards minus infinity also for negative counts."""
    return relative // decimation


@njit(inline=True, counted=False)
def spring(params: Any, law: Any, relative: int, dither_value: float, velocity: float) -> float:
    """Force of a virtual spring and its damping, N m or N; ``law`` is `PARAMS` or a `LAW`.

    A wall (``side``) never pulls: damping does not hold the shaft back when it leaves the wall.
    """
    if params.dither_target == DITHER_POSITION:
        quantised = np.floor(relative / law.decimation + dither_value)
    else:
        quantised = float(coarse_ticks(relative, law.decimation))
    force = -law.force_per_tick * (quantised + law.bias) - law.damping * velocity
    if (law.side == POSITIVE_SIDE and (quantised < 0.0 or force > 0.0)) or (
        law.side == NEGATIVE_SIDE and (quantised >= 0.0 or force < 0.0)
    ):
        force = 0.0
    return float(force)


@njit(inline=True, counted=False)
def within(force: float, largest: float) -> float:
    """A force (N m or N) clamped to ± the largest."""
    return max(-largest, min(largest, force))


@njit(counted=False)
def soften(servo: Any, force: float, shift: int, dither_value: float, velocity: float) -> float:
    """The force in the transition from the previous to the present spring, N m or N: s F_new + (1 − s) F_held.

    F_held follows the shaft like the previous spring, so that an oscillating shaft always has a spring and not a constant
    force. Both are limited as by the amplifier, so that s is also a share of the current.
    """
    params, state = servo.params, servo.state
    law = servo.held_law
    largest = params.peak_current * params.torque_constant
    new = within(force, largest)
    before = spring(params, law, state.counts - law.origin - shift, dither_value, velocity)
    held = within(within(before, largest) + state.held_offset, largest)
    state.softened = state.held_share * (held - new)
    # Includes one tick with a share of 0, so that a change right after the last step continues from there.
    if state.held_share > 0.0:
        state.held_share = max(state.held_share - params.soft_step * (1 + servo.tick.missed), 0.0)
    else:
        state.held_share = NO_RAMP
    return new + state.softened


@njit(inline=True, counted=False)
def begin_softly(servo: Any) -> None:
    """Begin the transition at the start of running: there is no previous spring."""
    params, state, law = servo.params, servo.state, servo.held_law
    law.force_per_tick = 0.0
    law.damping = 0.0
    law.decimation = 1
    state.held_offset = 0.0
    state.softened = 0.0
    state.held_share = 1.0 if params.soft_step > 0.0 and not params.abrupt else NO_RAMP


@njit(inline=True, counted=False)
def renew_law(servo: Any) -> None:
    """Begin the transition after new parameters, if they change the spring: the previous force fades."""
    params, state, law = servo.params, servo.state, servo.law
    changed = (
        law.force_per_tick != params.force_per_tick
        or law.bias != params.bias
        or law.damping != params.damping
        or law.side != params.side
        or law.origin != params.origin
        or law.decimation != params.decimation
    )
    if params.soft_step == 0.0:
        state.held_share = NO_RAMP
        state.softened = 0.0
    elif changed and state.mode == RUNNING:
        servo.held_law = law
        state.held_offset = state.softened
        state.held_share = 1.0
    if changed:
        law.force_per_tick = params.force_per_tick
        law.bias = params.bias
        law.damping = params.damping
        law.side = params.side
        law.origin = params.origin
        law.decimation = params.decimation
