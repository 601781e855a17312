"""The servo loop: one compiled function, two clocks.

Each tick: wake, **read** the driver, decimate, dither, spring (eq. 2), excitation, safety gate, delay T_V, DAC grid,
**write in the same tick**, record. With the monotonic clock it is the daemon's real-time thread; in virtual time the
same machine code is ``simulate``. It runs no Python, takes no lock and allocates nothing; see ``docs/code-overview.md``.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from hapticd.jit import atomic_load, atomic_store, call_driver, fence_acquire, njit
from hapticd.record.schema import (
    FLAG_DROPPED,
    FLAG_FAULT,
    FLAG_MISSED_EXCHANGE,
    FLAG_MISSED_PERIOD,
    FLAG_RUNNING,
    ROW,
)
from hapticd.servo import atomics, authority
from hapticd.servo._command import leave, write_current, write_zero
from hapticd.servo._passivity import show_energy
from hapticd.servo._render import render
from hapticd.servo._sync import wait_for_sync
from hapticd.servo.clock import grid_instant, now_ns, sleep_until
from hapticd.servo.follow import follow_current
from hapticd.servo.gate import check_exchange, check_load, count_late, step_mode, take_counts
from hapticd.servo.law import coarse_ticks, renew_law
from hapticd.servo.layout import FAULT, OFF, PASSIVITY_OFF, RETURN_RUNAWAY, RETURN_STOPPED, RETURN_TICKS, RUNNING, SERVO
from hapticd.servo.timing import count

_RUNAWAY_TICKS = 1_000_000_000

_SERVO = numba.from_dtype(SERVO)
_SHARED = numba.types.Array(numba.int64, 1, "C")
_ROWS = numba.types.Array(numba.from_dtype(ROW), 1, "C")
_TABLE = numba.types.Array(numba.float64, 2, "C")


@njit(inline=True, counted=False)
def wake(servo: Any, shared: Any) -> None:
    """Sleep until the next grid instant. Missed periods are skipped and counted, never caught up."""
    state, tick, period_ns = servo.state, servo.tick, servo.params.period_ns
    tick.number = state.next_tick
    steps = tick.number - state.grid_tick
    tick.ns, tick.frac = grid_instant(state.grid_ns, state.grid_frac, steps, period_ns)
    tick.woke_ns = tick.ns
    tick.late_ns = 0
    tick.missed = 0
    tick.waited_ns = 0
    if not servo.real_time:
        if state.replayed_skip > 0:
            tick.missed = state.replayed_skip
            tick.number += tick.missed
            tick.ns, tick.frac = grid_instant(state.grid_ns, state.grid_frac, steps + tick.missed, period_ns)
        tick.late_ns = state.replayed_late_ns
        tick.woke_ns = tick.ns + tick.late_ns
        state.replayed_skip = 0
        state.replayed_late_ns = 0
        return
    if servo.driver.wait != 0:
        wait_for_sync(servo, shared)
        return
    sleep_until(servo.timespec, tick.ns)
    tick.woke_ns = now_ns(servo.timespec)
    tick.late_ns = tick.woke_ns - tick.ns
    count(servo.late_histogram, tick.late_ns)
    shared[atomics.LATE_MAX_NS] = max(shared[atomics.LATE_MAX_NS], tick.late_ns)
    if tick.late_ns >= period_ns:
        tick.missed = int(tick.late_ns / period_ns)
        tick.number += tick.missed
        tick.ns, tick.frac = grid_instant(state.grid_ns, state.grid_frac, steps + tick.missed, period_ns)
        tick.late_ns = tick.woke_ns - tick.ns


@njit(inline=True, counted=False)
def take_parameters(servo: Any, shared: Any) -> bool:
    """Copy the newest parameter set if there is one; if it changes during the copy, repeat in the next tick."""
    sequence = atomic_load(shared, atomics.SEQUENCE)
    if sequence == servo.state.applied:
        return False
    servo.mailbox[2] = servo.mailbox[sequence & 1]
    fence_acquire()
    if atomic_load(shared, atomics.SEQUENCE) != sequence:
        return False
    servo.params = servo.mailbox[2]
    servo.state.applied = sequence
    atomic_store(shared, atomics.APPLIED, sequence)
    return True


@njit(inline=True, counted=False)
def begin_grid(servo: Any) -> None:
    """Start a new time grid at this tick, so that a change of the rate does not shift it."""
    state, tick = servo.state, servo.tick
    state.grid_tick = tick.number
    state.grid_ns = tick.ns
    state.grid_frac = tick.frac


@njit(inline=True, counted=False)
def count_miss(servo: Any, shared: Any) -> None:
    """Count a failed exchange, in total and in a row."""
    servo.tick.flags |= FLAG_MISSED_EXCHANGE
    servo.state.missed_in_a_row += 1
    shared[atomics.MISSED_EXCHANGES] += 1


@njit(inline=True, counted=False)
def read(servo: Any, shared: Any) -> None:
    """Read a sample from the driver."""
    exchange, driver, tick = servo.exchange, servo.driver, servo.tick
    exchange.tick = tick.number
    exchange.period_ns = servo.params.period_ns
    exchange.time_ns = tick.woke_ns
    exchange.time_frac = 0.0 if servo.real_time else tick.frac
    result = call_driver(driver.read, driver.state, driver.exchange)
    check_exchange(servo, shared, result)
    tick.fresh = result == 0
    tick.flags = FLAG_MISSED_PERIOD if tick.missed > 0 else 0
    if not tick.fresh:
        # Counted here, so that the last allowed miss gives zero current in this tick and not in the next.
        count_miss(servo, shared)


@njit(inline=True, counted=False)
def locate(servo: Any) -> None:
    """Counts and coarse ticks from the spring's origin, by the last good sample."""
    servo.tick.relative = servo.state.counts - servo.params.origin
    servo.tick.position = coarse_ticks(servo.tick.relative, servo.params.decimation)


@njit(inline=True, counted=False)
def end_exchange(servo: Any, shared: Any) -> None:
    """Count a failed write after a good read; each tick counts once."""
    if not servo.tick.fresh:
        return
    if servo.tick.written == 0:
        servo.state.missed_in_a_row = 0
    else:
        count_miss(servo, shared)


@njit(inline=True, counted=False)
def account(servo: Any, shared: Any) -> int:
    """Execution time of this tick without its sleep, ns."""
    if not servo.real_time:
        return 0
    spent_ns = now_ns(servo.timespec) - servo.tick.woke_ns - servo.tick.waited_ns
    count(servo.exec_histogram, spent_ns)
    shared[atomics.EXEC_MAX_NS] = max(shared[atomics.EXEC_MAX_NS], spent_ns)
    return spent_ns


@njit(inline=True, counted=False)
def show(servo: Any, shared: Any) -> None:
    """Write the snapshot for display."""
    snapshot, state = servo.snapshot, servo.state
    snapshot.position = servo.tick.relative / servo.params.decimation
    snapshot.velocity = state.speed * servo.params.raw_resolution
    snapshot.current = state.current
    snapshot.current_measured = servo.exchange.current_measured
    snapshot.force = servo.tick.force
    if servo.params.passivity != PASSIVITY_OFF:
        show_energy(servo)
    shared[atomics.COUNTS] = state.counts


@njit(inline=True, counted=False)
def record(servo: Any, shared: Any, ring: Any, truth: Any, spent_ns: int) -> None:
    """Write one row into the ring, or count it as dropped."""
    state, tick = servo.state, servo.tick
    head = shared[atomics.RING_HEAD]
    mask = len(ring) - 1
    if head - atomic_load(shared, atomics.RING_TAIL) > mask:
        shared[atomics.DROPPED] += 1
        return
    if shared[atomics.DROPPED] != state.dropped:
        state.dropped = shared[atomics.DROPPED]
        tick.flags |= FLAG_DROPPED
    row = ring[head & mask]
    row.tick = tick.number
    row.time_s = ((tick.ns - state.start_ns) + tick.frac) * 1e-9
    row.encoder_counts = state.counts
    row.ticks = tick.position
    row.current_command_A = state.current
    row.current_measured_A = servo.exchange.current_measured
    row.force_command = tick.force
    row.wake_late_ns = tick.late_ns
    row.exec_ns = spent_ns
    row.flags = tick.flags
    if len(truth) > 0:
        truth[head & mask, 0] = servo.exchange.true_position
        truth[head & mask, 1] = servo.exchange.true_velocity
    atomic_store(shared, atomics.RING_HEAD, head + 1)


@njit(inline=True, counted=False)
def tell(words: Any, mode: int) -> None:
    """Publish the number of ticks and the mode, for the stop channel."""
    atomic_store(words, authority.LOOP_MODE, mode)
    atomic_store(words, authority.LOOP_TICKS, words[authority.LOOP_TICKS] + 1)


@njit(numba.int64(_SERVO, _SHARED, _SHARED, _ROWS, _TABLE, _TABLE, numba.int64), counted=False)
def run(servo: Any, shared: Any, words: Any, ring: Any, truth: Any, excitation: Any, ticks: int) -> int:
    """Run ``ticks`` ticks (real time: until `STOP` is set) and return one of the RETURN_* reasons.

    Args:
        servo: a `SERVO` record: parameters, memory, driver, clock; in virtual time reused by the next call.
        shared: the atomics that other threads read or write (`hapticd.servo.atomics`).
        words: of the authority (`hapticd.servo.authority`).
        ring: rows; a power of two.
        truth: (rows of ring, 2) true state for ``simulate``, or (0, 2).
        excitation: (2, n) current in A and displacement of the origin in raw counts.
        ticks: number, in virtual time.
    """
    state, tick = servo.state, servo.tick
    done = 0
    while servo.real_time or done < ticks:
        done += 1
        wake(servo, shared)
        if servo.real_time and atomic_load(shared, atomics.STOP) != 0:
            leave(servo)
            tell(words, FAULT if state.mode == FAULT else OFF)
            return RETURN_STOPPED
        # After the stop, so that done plus missed ticks equal the tick number also at the end.
        shared[atomics.MISSED_PERIODS] += tick.missed
        if take_parameters(servo, shared):
            begin_grid(servo)
            renew_law(servo)

        read(servo, shared)
        count_late(servo)
        step_mode(servo, shared, words)
        if tick.fresh:
            take_counts(servo, shared)
        check_load(servo, shared)
        # NaN if the device measures none.
        if servo.exchange.current_measured == servo.exchange.current_measured and servo.params.mismatch < np.inf:
            follow_current(servo, shared)
        locate(servo)
        if not servo.real_time and abs(tick.position) > _RUNAWAY_TICKS:
            return RETURN_RUNAWAY

        if state.mode == RUNNING:
            tick.flags |= FLAG_RUNNING
            render(servo, shared, excitation)
        tick.force = state.force if state.mode == RUNNING else 0.0
        # The mode may have changed: a command that is not finite is a fault.
        tick.written = write_current(servo) if state.mode == RUNNING else write_zero(servo)
        check_exchange(servo, shared, tick.written)
        if state.mode == FAULT:
            tick.flags = (tick.flags | FLAG_FAULT) & ~FLAG_RUNNING
            if state.current != 0.0:
                # The write failed: write zero at once, before anything else.
                write_zero(servo)
        end_exchange(servo, shared)

        spent_ns = account(servo, shared)
        show(servo, shared)
        record(servo, shared, ring, truth, spent_ns)
        state.next_tick = tick.number + 1
        atomic_store(shared, atomics.TICKS, shared[atomics.TICKS] + 1)
        if servo.real_time:
            tell(words, state.mode)
    return RETURN_TICKS
