"""The loop on a device's clock (``servo.clock: sync``): a tick begins at the device's SYNC, not on the loop's own grid.

The grid of the loop is an estimate of the producer's: it moves by a quarter of each arrival's deviation, so
that the jitter of single arrivals averages out. Lateness and missed periods are measured against it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticd.jit import call_driver, njit
from hapticd.servo import atomics, faults
from hapticd.servo.clock import grid_instant, now_ns
from hapticd.servo.gate import raise_fault
from hapticd.servo.timing import count

_GAIN = 0.25
_LONGEST_NS = 100_000_000.0
"""Longest wait, for any ``safety.missed_exchanges``, so that the loop can end."""


@njit(inline=True, counted=False)
def wait_for_sync(servo: Any, shared: Any) -> None:
    """Sleep until the device's SYNC; none for more than ``safety.missed_exchanges`` periods is a fault."""
    state, tick, exchange, driver, params = servo.state, servo.tick, servo.exchange, servo.driver, servo.params
    period_ns = params.period_ns
    now = now_ns(servo.timespec)
    if state.sync_ns == 0:
        state.sync_ns = now
    left_ns = max(state.sync_ns + (params.missed_exchanges + 1.5) * period_ns - now, 1.5 * period_ns)
    exchange.tick = tick.number
    exchange.period_ns = period_ns
    exchange.time_ns = tick.ns if state.synced else 0
    exchange.deadline_ns = now + int(min(left_ns, max(_LONGEST_NS, 1.5 * period_ns)))
    came = call_driver(driver.wait, driver.state, driver.exchange) == 0
    tick.woke_ns = now_ns(servo.timespec)
    if state.synced:
        # Rounded to the nearest: an early SYNC is not the previous one.
        tick.missed = max(0, int(np.floor((tick.woke_ns - tick.ns) / period_ns + 0.5)))
        tick.number += tick.missed
        steps = tick.number - state.grid_tick
        tick.ns, tick.frac = grid_instant(state.grid_ns, state.grid_frac, steps, period_ns)
        tick.late_ns = tick.woke_ns - tick.ns
        count(servo.late_histogram, max(0, tick.late_ns))
        shared[atomics.LATE_MAX_NS] = max(shared[atomics.LATE_MAX_NS], tick.late_ns)
        state.grid_ns += int(_GAIN * tick.late_ns) if came else 0
    else:
        state.grid_ns += tick.woke_ns - tick.ns
        tick.ns = tick.woke_ns
    silent = (tick.woke_ns - state.sync_ns) / period_ns
    state.synced = came
    if came:
        state.sync_ns = tick.woke_ns
    elif params.safety and silent > params.missed_exchanges + 1.0:
        raise_fault(servo, shared, faults.SYNC_LOST, silent, params.missed_exchanges)
