"""The safety gate: the checks that raise a fault, and the modes off → ready → running → (fault, latched).

There is no automatic recovery. A fault keeps its number, the value that tripped it and the limit until a ``clear`` comes
with a later parameter set. Every exit from ``running``: zero current in the same tick, amplifier off in the next.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from drivers.interface import STATUS_ENABLED, STATUS_HELD
from hapticd.jit import atomic_load, atomic_max, atomic_store, njit
from hapticd.servo import atomics, authority, faults
from hapticd.servo._passivity import forget_energy
from hapticd.servo.law import begin_softly
from hapticd.servo.layout import FAULT, FAULT_ON_OVERRUN, OFF, READY, RUNNING


@njit(inline=True, counted=False)
def raise_fault(servo: Any, shared: Any, code: int, value: float, limit: float) -> None:
    """Latch a fault; only the first one is kept, because later ones are its consequences."""
    if servo.state.mode == FAULT:
        return
    servo.state.mode = FAULT
    numbers = shared.view(np.float64)
    numbers[atomics.FAULT_VALUE] = value
    numbers[atomics.FAULT_LIMIT] = limit
    shared[atomics.FAULT_TICK] = servo.tick.number
    atomic_store(shared, atomics.FAULT_CODE, code)
    atomic_store(shared, atomics.MODE, FAULT)


@njit(inline=True, counted=False)
def check_exchange(servo: Any, shared: Any, result: int) -> None:
    """Raise a fault for a driver's return value other than OK (0) and MISSED (1)."""
    if result == 2:
        raise_fault(servo, shared, faults.DEVICE_FAULT, servo.exchange.device_code, 0.0)
    elif result == -1:
        raise_fault(servo, shared, faults.DRIVER_ERROR, result, 0.0)
    elif result < -1 or result > 2:
        # Also after another fault, such as that of missed exchanges before the driver reported the loss.
        atomic_store(shared, atomics.DEVICE_LOST, 1)
        raise_fault(servo, shared, faults.DRIVER_LOST, result, 0.0)


@njit(inline=True, counted=False)
def proven(counts: float) -> float:
    """Displacement that a difference of two counts proves, in counts: one less, because of the quantisation of both.

    All trips on encoder counts use it. Two counts in a period prove a displacement of one count.
    """
    return max(abs(counts) - 1.0, 0.0)


@njit(inline=True, counted=False)
def take_counts(servo: Any, shared: Any) -> None:
    """Accept a new sample: speed from the elapsed time, then the trips on jump, over-speed and excursion."""
    params, state, tick = servo.params, servo.state, servo.tick
    counts = -servo.exchange.counts if params.invert else servo.exchange.counts
    watching = params.safety and state.mode == RUNNING
    if state.have_counts:
        moved = counts - state.counts
        elapsed = max(tick.woke_ns - state.counts_ns, int(0.5 * params.period_ns))
        state.speed = moved * 1e9 / elapsed
        if watching:
            # A later sample may have moved further: the limit is per elapsed period.
            periods = 1 + tick.missed + state.missed_in_a_row
            scale = params.raw_resolution
            fastest = proven(moved) * 1e9
            if proven(moved) > params.encoder_jump * periods:
                raise_fault(servo, shared, faults.ENCODER_JUMP, moved, params.encoder_jump)
            elif fastest > params.max_speed * elapsed:
                fastest = np.copysign(fastest / elapsed, moved)
                raise_fault(servo, shared, faults.OVER_SPEED, fastest * scale, params.max_speed * scale)
    if watching:
        excursion = float(counts) - float(params.origin)
        farthest = proven(excursion)
        if farthest > params.max_excursion:
            scale = params.raw_resolution
            farthest = np.copysign(farthest, excursion)
            raise_fault(servo, shared, faults.EXCURSION, farthest * scale, params.max_excursion * scale)
    state.counts = counts
    state.counts_ns = tick.woke_ns
    state.have_counts = True


@njit(inline=True, counted=False)
def count_late(servo: Any) -> None:
    """Count missed periods, minus punctual ticks: one long freeze and frequent late ticks count alike.

    Called before the state machine, which resets the count when ``running`` begins.
    """
    missed = servo.tick.missed
    servo.state.late_periods = max(0, servo.state.late_periods + (missed if missed > 0 else -1))


@njit(inline=True, counted=False)
def check_load(servo: Any, shared: Any) -> None:
    """Trips on missed periods, missed exchanges, and the I²t of the current since the last tick."""
    params, state, missed = servo.params, servo.state, servo.tick.missed
    if not params.safety:
        return
    if state.mode == RUNNING:
        if params.overrun_policy == FAULT_ON_OVERRUN and missed > 0:
            raise_fault(servo, shared, faults.OVERRUN, missed, 1.0)
        elif state.late_periods >= params.overrun_fault_after:
            raise_fault(servo, shared, faults.OVERRUN, state.late_periods, params.overrun_fault_after)
    if state.missed_in_a_row > params.missed_exchanges:
        raise_fault(servo, shared, faults.MISSED_EXCHANGES, state.missed_in_a_row, params.missed_exchanges)
    if np.isfinite(params.continuous_current):
        seconds = params.period_ns * 1e-9 * (1 + missed)
        state.i2t = max(0.0, state.i2t + (state.current**2 - params.continuous_current**2) * seconds)
        shared.view(np.float64)[atomics.I2T] = state.i2t  # survives the process
        if state.i2t > params.i2t_limit:
            raise_fault(servo, shared, faults.OVER_CURRENT, state.i2t, params.i2t_limit)


@njit(inline=True, counted=False)
def forget_motion(servo: Any) -> None:
    """Reset the state of the motion: nothing from before a (re)start may trip a limit or be commanded."""
    state = servo.state
    state.have_counts = False
    state.missed_in_a_row = 0
    state.late_periods = 0
    state.delayed_head = 0
    state.delayed_tail = 0
    state.speed = 0.0
    state.velocity_samples = 0
    forget_energy(servo)
    begin_softly(servo)


@njit(inline=True, counted=False)
def step_mode(servo: Any, shared: Any, words: Any) -> None:
    """One step of the state machine: clear, estop, heartbeat, then the supervisor's request, unless revoked."""
    params, state, now_ns = servo.params, servo.state, servo.tick.woke_ns
    estops, revoked = atomic_load(words, authority.ESTOPS), atomic_load(words, authority.REVOKED)
    if params.clear != state.cleared:
        state.cleared = params.clear
        if state.mode == FAULT and params.clear > words[authority.FAULTED]:
            state.mode = OFF
            forget_motion(servo)
            atomic_store(shared, atomics.FAULT_CODE, 0)
            atomic_store(shared, atomics.DEVICE_LOST, 0)
    if state.mode != FAULT or estops != state.estops:
        words[authority.FAULTED] = max(now_ns, revoked)
    if estops != state.estops:
        state.estops = estops
        raise_fault(servo, shared, faults.ESTOP, 0.0, 0.0)
    if params.fault != 0 and state.mode == RUNNING and params.ordinal > revoked:
        raise_fault(servo, shared, params.fault, params.fault_value, params.fault_limit)
    # With the amplifier off nothing can happen; in virtual time there is no supervisor.
    if servo.real_time and params.heartbeat_ns > 0.0 and state.mode != OFF:
        silence = now_ns - atomic_load(shared, atomics.HEARTBEAT_NS)
        if silence > params.heartbeat_ns:
            raise_fault(servo, shared, faults.HEARTBEAT_LOST, silence * 1e-6, params.heartbeat_ns * 1e-6)
    # The status bits of the device, from the last good exchange.
    enabled, held = (servo.exchange.status & STATUS_ENABLED) != 0, (servo.exchange.status & STATUS_HELD) != 0
    if params.enable and not held and shared[atomics.HELD] != 0:
        # A release acts like a stop: it revokes every command sent before, so that none moves the motor when held again.
        atomic_max(words, authority.REVOKED, now_ns)
    atomic_store(shared, atomics.HELD, 1 if held else 0)
    if state.mode == FAULT:
        return
    mode = state.mode
    if params.request == OFF or params.ordinal <= revoked:
        mode = OFF
    elif params.enable and not held:
        raise_fault(servo, shared, faults.ENABLE_RELEASED, 0.0, 0.0)
        return
    elif mode == OFF:
        mode = READY
        state.enable_ns = now_ns
    elif mode == READY:
        if enabled and servo.tick.fresh and params.request == RUNNING:
            mode = RUNNING
            forget_motion(servo)
        elif not enabled and now_ns - state.enable_ns > params.enable_timeout_ns:
            limit = params.enable_timeout_ns * 1e-9
            raise_fault(servo, shared, faults.ENABLE_TIMEOUT, limit, limit)
            return
    elif not enabled:
        raise_fault(servo, shared, faults.AMPLIFIER_DROPPED, 0.0, 0.0)
        return
    elif params.request == READY:
        mode = READY
    state.mode = mode
    atomic_store(shared, atomics.MODE, mode)
