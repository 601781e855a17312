"""The passivity observer and controller in the loop (`safety.passivity`); equations: `hapticd.stability.passivity`.

The observer adds up the energy from the last written current and the raw counts in every tick with a rendered spring. While
an excitation plays, observer and controller are off, because its energy is intended.
"""

from __future__ import annotations

from typing import Any

from hapticd.jit import njit
from hapticd.record.schema import FLAG_EXCITATION
from hapticd.servo.layout import PASSIVITY_CONTROL
from hapticd.stability.passivity import dissipating_force, spring_potential


@njit(inline=True, counted=False)
def forget_energy(servo: Any) -> None:
    """Reset the energies."""
    state = servo.state
    state.observes = False
    state.moved = 0.0
    state.put_out = 0.0
    state.generated = 0.0
    state.excess = 0.0
    state.dissipated = 0.0
    state.passivity_current = 0.0


@njit(inline=True, counted=False)
def potential(params: Any, counts: int) -> float:
    """Potential of the spring in the middle of a raw count, J."""
    xi = (counts - params.origin + 0.5) / params.decimation
    tick = params.raw_resolution * params.decimation
    return float(params.force_per_tick * tick * spring_potential(xi, params.bias, float(params.side)))


@njit(inline=True, counted=False)
def observe(servo: Any) -> None:
    """Add the energies of the period that ends with this tick."""
    params, state, tick = servo.params, servo.state, servo.tick
    stored = potential(params, state.counts)
    if state.observes and state.observed_tick == tick.number - tick.missed - 1:
        state.moved = (state.counts - state.observed_counts) * params.raw_resolution
        work = state.current * params.torque_constant * state.moved
        before = state.observed_potential
        if state.observed_set != state.applied:
            before = potential(params, state.observed_counts)
        generated = work + stored - before
        state.put_out += work
        state.generated += generated
        state.excess = max(0.0, state.excess + generated)
        state.dissipated -= state.passivity_current * params.torque_constant * state.moved
    else:
        state.observes = False
    state.observed_tick = tick.number
    state.observed_counts = state.counts
    state.observed_potential = stored
    state.observed_set = state.applied


@njit(inline=True, counted=False)
def control(servo: Any, current: float, limit: float) -> float:
    """The rendered current plus the one that dissipates the excess, within the limit, A."""
    params, state = servo.params, servo.state
    excited = (servo.tick.flags & FLAG_EXCITATION) != 0
    known = state.observes and not excited
    state.observes = not excited
    state.passivity_current = 0.0
    if params.passivity != PASSIVITY_CONTROL or not known or state.excess == 0.0 or state.moved == 0.0:
        return current
    added = dissipating_force(state.excess, state.moved, params.passivity_stiffest) / params.torque_constant
    whole = max(-limit, min(limit, current + added))
    state.passivity_current = whole - current
    return whole


@njit(inline=True, counted=False)
def show_energy(servo: Any) -> None:
    """Write the energies into the snapshot."""
    snapshot, state = servo.snapshot, servo.state
    snapshot.put_out = state.put_out
    snapshot.generated = state.generated
    snapshot.excess = state.excess
    snapshot.dissipated = state.dissipated
    snapshot.passivity_current = state.passivity_current
