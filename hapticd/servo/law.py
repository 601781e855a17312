"""The law of the rendered spring, and how one passes into the next.

    F_V = −K Δ (⌊x/Δ⌋ + ½) − B v,   ⌊x/Δ⌋ = ⌊(raw − origin) / N⌋                (eq. 2)
    F   = s F_V + (1 − s) F_held,   s from 0 to 1 over `safety.soft_start_s`

with Δ = N raw counts and v as `hapticd.servo.damping` estimates it. The floor of the raw encoder nests,
⌊⌊x/δ⌋/N⌋ = ⌊x/(N δ)⌋, so decimation is exact, also below zero. F_held is 0 where running begins, and the spring before where
it is another one since: `docs/decisions/0071-soft-start.md`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticd.jit import njit
from hapticd.servo.layout import DITHER_POSITION, NEGATIVE_SIDE, NO_RAMP, POSITIVE_SIDE, RUNNING


@njit(inline=True, counted=False)
def coarse_ticks(relative: int, decimation: int) -> int:
    """⌊relative / N⌋, towards minus infinity for negative counts too."""
    return relative // decimation


@njit(inline=True, counted=False)
def spring(params: Any, law: Any, relative: int, dither_value: float, velocity: float) -> float:
    """Force of a virtual spring and its damping, N m or N; ``law`` is `PARAMS` or a `LAW`.

    A wall (``side``) ends where it would pull: damping alone never holds the shaft back on its way out.
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
    """A force (N m or N) that is clamped to ± the largest."""
    return max(-largest, min(largest, force))


@njit(counted=False)
def soften(servo: Any, force: float, shift: int, dither_value: float, velocity: float) -> float:
    """The force between the spring before and the one in force, N m or N: s F_new + (1 − s) F_held.

    F_held follows the shaft as the spring before does, so that one that swings finds a spring all the time, and not a
    constant push. Both are taken as the amplifier would give them: s is then a share of the current, too.
    """
    params, state = servo.params, servo.state
    law = servo.held_law
    largest = params.peak_current * params.torque_constant
    new = within(force, largest)
    before = spring(params, law, state.counts - law.origin - shift, dither_value, velocity)
    held = within(within(before, largest) + state.held_offset, largest)
    state.softened = state.held_share * (held - new)
    # Down to a share of 0 and one tick with it: a change that comes right after the last step goes on from there.
    if state.held_share > 0.0:
        state.held_share = max(state.held_share - params.soft_step * (1 + servo.tick.missed), 0.0)
    else:
        state.held_share = NO_RAMP
    return new + state.softened


@njit(inline=True, counted=False)
def begin_softly(servo: Any) -> None:
    """Running begins: the spring before is none."""
    params, state, law = servo.params, servo.state, servo.held_law
    law.force_per_tick = 0.0
    law.damping = 0.0
    law.decimation = 1
    state.held_offset = 0.0
    state.softened = 0.0
    state.held_share = 1.0 if params.soft_step > 0.0 and not params.abrupt else NO_RAMP


@njit(inline=True, counted=False)
def renew_law(servo: Any) -> None:
    """New parameters are in force: where the spring is another one, what was rendered until now fades."""
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
