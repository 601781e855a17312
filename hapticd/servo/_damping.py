"""Velocity estimate of the virtual damping, from the coarse positions of the spring.

    v(k) = Δ (⌊x(k)/Δ⌋ − ⌊x(k−n)/Δ⌋) / (n T)                    difference over n periods
    v(k) = a v(k−1) + (1 − a) Δ (⌊x(k)/Δ⌋ − ⌊x(k−1)/Δ⌋) / T      low-pass of cut-off f, a = e^(−2π f T)

The history contains raw counts with their ticks: a change of origin or decimation does not affect it, and a skipped period
or a failed exchange gives a difference over more periods, not a wrong one.
"""

from __future__ import annotations

from typing import Any

from hapticd.jit import njit
from hapticd.servo.layout import MOST_SAMPLES

_MASK = MOST_SAMPLES - 1


@njit(inline=True, counted=False)
def estimate_velocity(servo: Any) -> float:
    """Velocity of the coarse position, counts/s; 0 in the first tick."""
    params, state, tick = servo.params, servo.state, servo.tick
    if state.velocity_tick != tick.number - tick.missed - 1 or state.velocity_period_ns != params.period_ns:
        state.velocity_samples = 0  # the damping was off, or the rate has changed
    state.velocity_tick = tick.number
    state.velocity_period_ns = params.period_ns
    known = state.velocity_samples
    if known == 0:
        state.velocity = 0.0
    elif not tick.fresh:
        return state.velocity
    else:
        past = servo.samples[(known - min(params.velocity_periods, known)) & _MASK]
        decimation = params.decimation
        moved = tick.position - (past.counts - params.origin) // decimation
        periods = tick.number - past.tick
        difference = moved * decimation * 1e9 / (periods * params.period_ns)
        keep = params.velocity_keep if periods == 1 else params.velocity_keep**periods
        state.velocity = keep * state.velocity + (1.0 - keep) * difference if keep > 0.0 else difference
    sample = servo.samples[known & _MASK]
    sample.counts, sample.tick = state.counts, tick.number
    state.velocity_samples = known + 1
    return state.velocity
