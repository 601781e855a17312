"""Comparison of measured and commanded current: the trip `current_mismatch`.

The amplifier is a current loop of second order, i'' = ω² (u − i) − 2 δ ω i' with ω = 2π `bandwidth_hz`, δ = `damping_ratio`.
With the command held for a period T, the difference e = i − u and r = i'/ω change by the exact transition exp(A ω T),
A = [[0, 1], [−1, −2δ]], computed in Python for each parameter set. Until the next command e² + r² never grows, so that
the current is within u ± (|e| + |r|) at every instant of the period.

A sample may be a few periods old: a command may change within a period (T_V), a link has a latency, and the theory's
amplifier is a pure delay. So the measured current is compared with the range of the current in the last one to two blocks of
periods; a block is twice the lag plus three periods.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hapticd.jit import njit
from hapticd.plant.electrical import largest_current
from hapticd.servo import faults
from hapticd.servo.gate import raise_fault
from hapticd.servo.layout import READY, RUNNING
from hapticd.stability.numbers import loop_from_config

if TYPE_CHECKING:
    from hapticd.config import Config

SHARE = 0.1
"""Relative tolerance in addition to `safety.current_mismatch`: for errors of the drive's scale and of its sensor."""
_FEWEST_SAMPLES = 3


def follow_parameters(config: Config, latency_s: float) -> dict[str, float]:
    """The fields of `hapticd.servo.layout.PARAMS` that this module uses.

    Args:
        config: the configuration. latency_s: the driver's declared latency.
    """
    period, limits, amplifier = config.period, config.safety, config.amplifier
    lag = loop_from_config(config, latency_s).delay - config.delay.computation_s
    ii, ir, ri, rr = transition(2.0 * math.pi * amplifier.bandwidth_hz * period, amplifier.damping_ratio)
    return {
        "mismatch_ticks": max(_FEWEST_SAMPLES, math.ceil(limits.current_mismatch_s / period)),
        "mismatch_block": math.ceil(2.0 * lag / period) + 3,
        "current_limit": largest_current(config.plant.effects),
        "follow_ii": ii,
        "follow_ir": ir,
        "follow_ri": ri,
        "follow_rr": rr,
    }


def transition(turned: float, damping: float) -> tuple[float, float, float, float]:
    """exp(A ωT) by rows, for `turned` = ωT; all zero for 0, an amplifier without lag.

    Args:
        turned: ωT, rad. damping: δ.
    """
    if turned == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    # A has the eigenvalues −δ ± √(δ² − 1); for equal ones both forms have the limit sin(x)/x.
    root = damping * damping - 1.0
    step = math.sqrt(abs(root)) * turned
    if step < 1e-6:
        fade = math.exp(-damping * turned)
        even, odd = fade, fade * turned
    elif root < 0.0:
        fade = math.exp(-damping * turned)
        even, odd = fade * math.cos(step), fade * math.sin(step) / math.sqrt(-root)
    else:
        slow, fast = math.exp(step - damping * turned), math.exp(-step - damping * turned)
        even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / math.sqrt(root)
    return even + damping * odd, odd, -odd, even - damping * odd


@njit(inline=True, counted=False)
def follow_current(servo: Any, shared: Any) -> None:
    """Advance the amplifier's model by the period that ends with this tick, and compare the sample with it."""
    params, state, tick, measured = servo.params, servo.state, servo.tick, servo.exchange.current_measured
    command = max(-params.current_limit, min(params.current_limit, state.current))
    away, rate = state.followed - command, state.follow_rate
    if tick.missed > 0:
        away, rate = 0.0, 0.0  # enough periods were skipped to settle
    reach = abs(away) + abs(rate)
    state.followed = command + params.follow_ii * away + params.follow_ir * rate
    state.follow_rate = params.follow_ri * away + params.follow_rr * rate
    low, high = command - reach, command + reach
    state.block_ticks += 1
    if state.block_ticks > params.mismatch_block:
        state.block_ticks = 1
        state.block_low, state.block_high = state.current_low, state.current_high
    else:
        low, high = min(low, state.current_low), max(high, state.current_high)
    state.current_low, state.current_high = low, high
    if state.mode != RUNNING and state.mode != READY:
        state.mismatched = 0
        return
    if not tick.fresh:
        return
    low, high = min(low, state.block_low), max(high, state.block_high)
    low -= params.mismatch + SHARE * abs(low)
    high += params.mismatch + SHARE * abs(high)
    # NaN if nothing is measured: no comparison is true.
    if measured > high or measured < low:
        state.mismatched += 1
        if state.mismatched >= params.mismatch_ticks:
            raise_fault(servo, shared, faults.CURRENT_MISMATCH, measured, high if measured > high else low)
    else:
        state.mismatched = 0
