"""The servo loop: one compiled function, two clocks.

Each tick: wake, **read** the driver, decimate, dither, spring (eq. 2), excitation, safety gate, delay T_V, DAC grid,
**write in the same tick**, record. With the monotonic clock it is the daemon's real-time thread; in virtual time the very
same code is ``simulate``. It runs no Python, takes no lock and allocates nothing; see ``docs/code-overview.md``.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from drivers.interface import (
    STATUS_ENABLED,
    X_COUNTS,
    X_CURRENT_MEASURED,
    X_DEVICE_CODE,
    X_PERIOD_NS,
    X_STATUS,
    X_TICK,
    X_TIME_FRAC,
    X_TIME_NS,
    X_TRUE_POSITION,
    X_TRUE_VELOCITY,
)
from hapticd.jit import atomic_load, atomic_store, call_driver, fence_acquire, njit
from hapticd.record.schema import (
    FLAG_CLAMPED,
    FLAG_EXCITATION,
    FLAG_FAULT,
    FLAG_HELD,
    FLAG_MISSED_EXCHANGE,
    FLAG_MISSED_PERIOD,
    FLAG_RUNNING,
    ROW,
)
from hapticd.servo import faults
from hapticd.servo import layout as w
from hapticd.servo.clock import grid_instant, now_ns, sleep_until
from hapticd.servo.command import leave, write_current, write_zero
from hapticd.servo.gate import check_exchange, check_load, raise_fault, step_state, take_counts
from hapticd.servo.render import coarse_ticks, dither, spring
from hapticd.servo.timing import count

_NON_FINITE = faults.NON_FINITE
_RUNAWAY_TICKS = 1_000_000_000

_ROWS = numba.types.Array(numba.from_dtype(ROW), 1, "C")
_I = numba.types.Array(numba.int64, 1, "C")
_F = numba.types.Array(numba.float64, 1, "C")
_F2 = numba.types.Array(numba.float64, 2, "C")
_i = numba.int64


@njit(numba.boolean(_F2, _I, _F, _I), inline=True, counted=False)
def take_parameters(mailbox: NDArray[Any], control: NDArray[Any], params: NDArray[Any], ints: NDArray[Any]) -> bool:
    """Copy the newest parameter set if there is one; a torn read keeps the old set and is tried again next tick."""
    sequence = atomic_load(control, w.C_SEQUENCE)
    if sequence == ints[w.W_APPLIED]:
        return False
    for word in range(w.PARAMETERS):
        mailbox[2, word] = mailbox[sequence & 1, word]
    fence_acquire()
    if atomic_load(control, w.C_SEQUENCE) != sequence:
        return False
    for word in range(w.PARAMETERS):
        params[word] = mailbox[2, word]
    ints[w.W_APPLIED] = sequence
    return True


@njit(_i(_F, _I, _F, _I, _F, _F2, _i, _i, _i), inline=True, counted=False)
def render(
    params: NDArray[Any],
    control: NDArray[Any],
    snapshot: NDArray[Any],
    ints: NDArray[Any],
    floats: NDArray[Any],
    excitation: NDArray[Any],
    tick: int,
    relative: int,
    missed: int,
) -> int:
    """Force and clamped current of this tick into ``floats``; faults on a non-finite one. Returns FLAG_* bits."""
    flags = 0
    if missed > 0 and params[w.P_OVERRUN_POLICY] == w.HOLD:
        return FLAG_HELD
    extra_current = 0.0
    shift = 0
    excited = int(params[w.P_EXCITATION_ID])
    if excited != ints[w.W_EXCITATION_ID]:
        ints[w.W_EXCITATION_ID] = excited
        ints[w.W_EXCITATION_START] = tick
    if excited != 0:
        step = tick - ints[w.W_EXCITATION_START]
        if step < int(params[w.P_EXCITATION_LENGTH]):
            flags |= FLAG_EXCITATION
            extra_current = excitation[0, step]
            shift = int(excitation[1, step])
        else:
            atomic_store(control, w.C_EXCITATION_DONE, excited)
    wobble = dither(params, ints, floats, 1 + missed)
    force, current = spring(params, relative - shift, wobble, extra_current)
    if not np.isfinite(current):
        raise_fault(control, snapshot, ints, tick, _NON_FINITE, current, 0.0)
        return flags
    if params[w.P_SAFETY] > 0.0 and abs(current) > params[w.P_PEAK_CURRENT]:
        current = np.copysign(params[w.P_PEAK_CURRENT], current)
        control[w.C_CLAMPED] += 1
        flags |= FLAG_CLAMPED
    floats[w.V_FORCE] = force
    floats[w.V_REQUESTED] = current
    return flags


@njit(_i(_F2, _I, _F, _F, _I, _F, _I, _I, _I, _F2, _ROWS, _F2, _F2, _I, _F, _I, _I, numba.boolean, _i), counted=False)
def run(
    mailbox: NDArray[Any],
    control: NDArray[Any],
    params: NDArray[Any],
    snapshot: NDArray[Any],
    ints: NDArray[Any],
    floats: NDArray[Any],
    late_histogram: NDArray[Any],
    exec_histogram: NDArray[Any],
    fifo_ns: NDArray[Any],
    fifo: NDArray[Any],
    ring: NDArray[Any],
    truth: NDArray[Any],
    excitation: NDArray[Any],
    exchange: NDArray[Any],
    exchange_floats: NDArray[Any],
    timespec: NDArray[Any],
    pointers: NDArray[Any],
    real_time: bool,
    ticks: int,
) -> int:
    """Run ``ticks`` ticks (real time: until C_STOP) and return one of the RETURN_* reasons.

    Args:
        mailbox: (3, PARAMETERS) two parameter sets and a scratch row. control: CONTROL_WORDS. params: set in force.
        snapshot: SNAPSHOT_WORDS. ints, floats: the loop's memory, kept between calls in virtual time.
        late_histogram, exec_histogram: BUCKETS each, ns.
        fifo_ns, fifo: FIFO_LENGTH due times (ns) and (2, FIFO_LENGTH) their fractions and currents.
        ring: rows; a power of two. truth: (rows of ring, 2) true state for ``simulate``, or (0, 2).
        excitation: (2, n) current in A and displacement of the origin in raw counts.
        exchange, exchange_floats: the driver's 16 words and their floating-point side. timespec: two scratch words.
        pointers: read, write, state, exchange.
        real_time: monotonic clock, else virtual time. ticks: how many, in virtual time.
    """
    ring_mask = len(ring) - 1
    done = 0
    while real_time or done < ticks:
        done += 1
        # Wake. A missed period is skipped on the grid, counted, never caught up.
        tick = ints[w.W_TICK]
        period_ns = params[w.P_PERIOD_NS]
        grid = tick - ints[w.W_GRID_TICK]
        ns, frac = grid_instant(ints[w.W_GRID_NS], floats[w.V_GRID_FRAC], grid, period_ns)
        missed = 0
        woke = ns
        late = 0
        if real_time:
            sleep_until(timespec, ns)
            woke = now_ns(timespec)
            late = woke - ns
            count(late_histogram, late)
            control[w.C_LATE_MAX_NS] = max(control[w.C_LATE_MAX_NS], late)
            if late >= period_ns:
                missed = int(late / period_ns)
                tick += missed
                ns, frac = grid_instant(ints[w.W_GRID_NS], floats[w.V_GRID_FRAC], grid + missed, period_ns)
                late = woke - ns
            if atomic_load(control, w.C_STOP) != 0:
                leave(params, ints, floats, exchange, exchange_floats, pointers, woke)
                return w.RETURN_STOPPED
            # After the stop, so that ticks done and missed add up to the tick number also at the end.
            control[w.C_MISSED] += missed
        if take_parameters(mailbox, control, params, ints):
            # A new rate starts a new grid at this tick, so the change itself moves no sample in time.
            ints[w.W_GRID_TICK] = tick
            ints[w.W_GRID_NS] = ns
            floats[w.V_GRID_FRAC] = frac
            period_ns = params[w.P_PERIOD_NS]
            atomic_store(control, w.C_APPLIED, ints[w.W_APPLIED])

        # Read.
        exchange[X_TICK] = tick
        exchange_floats[X_PERIOD_NS] = period_ns
        exchange[X_TIME_NS] = woke
        exchange_floats[X_TIME_FRAC] = 0.0 if real_time else frac
        result = call_driver(pointers[0], pointers[2], pointers[3])
        check_exchange(control, snapshot, ints, tick, result, exchange[X_DEVICE_CODE])
        flags = FLAG_MISSED_PERIOD if missed > 0 else 0
        enabled = (exchange[X_STATUS] & STATUS_ENABLED) != 0
        step_state(params, control, snapshot, ints, floats, tick, woke, enabled, result == 0, real_time)
        if result == 0:
            counts = -exchange[X_COUNTS] if params[w.P_INVERT] > 0.0 else exchange[X_COUNTS]
            take_counts(params, control, snapshot, ints, floats, tick, woke, counts, missed)
        check_load(params, control, snapshot, ints, floats, tick, missed)

        # Render.
        relative = ints[w.W_COUNTS] - int(params[w.P_ORIGIN])
        position = coarse_ticks(relative, int(params[w.P_DECIMATION]))
        if not real_time and abs(position) > _RUNAWAY_TICKS:
            return w.RETURN_RUNAWAY
        if ints[w.W_STATE] == w.RUNNING:
            flags |= FLAG_RUNNING
            flags |= render(params, control, snapshot, ints, floats, excitation, tick, relative, missed)
        force = floats[w.V_FORCE] if ints[w.W_STATE] == w.RUNNING else 0.0

        # Write, in the same tick.
        waited = 0
        if ints[w.W_STATE] == w.RUNNING:
            written, waited, extra = write_current(
                params, ints, floats, fifo_ns, fifo, exchange, exchange_floats, pointers, timespec, ns, frac, real_time
            )
            flags |= extra
        else:
            at = now_ns(timespec) if real_time else ns
            written = write_zero(params, ints, floats, exchange, exchange_floats, pointers, at)
        check_exchange(control, snapshot, ints, tick, written, exchange[X_DEVICE_CODE])
        if ints[w.W_STATE] == w.FAULT:
            flags |= FLAG_FAULT
            flags &= ~FLAG_RUNNING
            if floats[w.V_CURRENT] != 0.0:
                # The write itself failed: try zero again at once, before anything else happens.
                at = now_ns(timespec) if real_time else ns
                write_zero(params, ints, floats, exchange, exchange_floats, pointers, at)
        if result == 0 and written == 0:
            ints[w.W_MISSED_IN_A_ROW] = 0
        else:
            flags |= FLAG_MISSED_EXCHANGE
            ints[w.W_MISSED_IN_A_ROW] += 1
            control[w.C_EXCHANGES_MISSED] += 1

        # Account for the tick, and record.
        spent = 0
        if real_time:
            spent = now_ns(timespec) - woke - waited
            count(exec_histogram, spent)
            control[w.C_EXEC_MAX_NS] = max(control[w.C_EXEC_MAX_NS], spent)
        snapshot[w.S_POSITION] = relative / params[w.P_DECIMATION]
        snapshot[w.S_VELOCITY] = floats[w.V_SPEED] * params[w.P_RAW_RESOLUTION]
        snapshot[w.S_CURRENT] = floats[w.V_CURRENT]
        snapshot[w.S_CURRENT_MEASURED] = exchange_floats[X_CURRENT_MEASURED]
        snapshot[w.S_FORCE] = force
        control[w.C_COUNTS] = ints[w.W_COUNTS]
        head = control[w.C_RING_HEAD]
        if head - atomic_load(control, w.C_RING_TAIL) <= ring_mask:
            row = ring[head & ring_mask]
            row.tick = tick
            row.time_s = ((ns - ints[w.W_START_NS]) + frac) * 1e-9
            row.encoder_counts = ints[w.W_COUNTS]
            row.ticks = position
            row.current_command_A = floats[w.V_CURRENT]
            row.current_measured_A = exchange_floats[X_CURRENT_MEASURED]
            row.force_command = force
            row.wake_late_ns = late
            row.exec_ns = spent
            row.flags = flags
            if len(truth) > 0:
                truth[head & ring_mask, 0] = exchange_floats[X_TRUE_POSITION]
                truth[head & ring_mask, 1] = exchange_floats[X_TRUE_VELOCITY]
            atomic_store(control, w.C_RING_HEAD, head + 1)
        else:
            control[w.C_DROPPED] += 1
        ints[w.W_TICK] = tick + 1
        atomic_store(control, w.C_TICKS, control[w.C_TICKS] + 1)
    return w.RETURN_TICKS
