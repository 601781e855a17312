"""The safety gate: what may end a tick in a fault, and the states off → ready → running → (fault, latched).

Nothing here recovers by itself. A fault keeps its number, the value that tripped it and the limit until a ``clear`` comes
with a later parameter set; leaving ``running`` by any way means zero current in the same tick, amplifier off in the next.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.jit import atomic_load, atomic_store, njit
from hapticd.servo import faults
from hapticd.servo.layout import (
    C_ESTOP,
    C_FAULT_CODE,
    C_FAULT_TICK,
    C_HEARTBEAT_NS,
    C_STATE,
    FAULT,
    FAULT_ON_OVERRUN,
    OFF,
    P_CLEAR,
    P_CONTINUOUS_CURRENT,
    P_ENABLE_TIMEOUT_NS,
    P_ENCODER_JUMP,
    P_HEARTBEAT_NS,
    P_I2T_LIMIT,
    P_MAX_EXCURSION,
    P_MAX_SPEED,
    P_MISSED_EXCHANGES,
    P_ORIGIN,
    P_OVERRUN_FAULT_AFTER,
    P_OVERRUN_POLICY,
    P_PERIOD_NS,
    P_RAW_RESOLUTION,
    P_REQUEST,
    P_SAFETY,
    READY,
    RUNNING,
    S_FAULT_LIMIT,
    S_FAULT_VALUE,
    S_I2T,
    V_CURRENT,
    V_I2T,
    V_SPEED,
    W_CLEAR,
    W_COUNTS,
    W_COUNTS_NS,
    W_ESTOP,
    W_FIFO_HEAD,
    W_FIFO_TAIL,
    W_HAVE_COUNTS,
    W_MISSED_IN_A_ROW,
    W_OVERRUNS_IN_A_ROW,
    W_REQUEST_NS,
    W_STATE,
)

_OVER_CURRENT = faults.OVER_CURRENT
_OVER_SPEED = faults.OVER_SPEED
_EXCURSION = faults.EXCURSION
_ENCODER_JUMP = faults.ENCODER_JUMP
_MISSED_EXCHANGES = faults.MISSED_EXCHANGES
_OVERRUN = faults.OVERRUN
_DRIVER_LOST = faults.DRIVER_LOST
_DRIVER_ERROR = faults.DRIVER_ERROR
_DEVICE_FAULT = faults.DEVICE_FAULT
_HEARTBEAT_LOST = faults.HEARTBEAT_LOST
_ESTOP = faults.ESTOP
_ENABLE_TIMEOUT = faults.ENABLE_TIMEOUT
_AMPLIFIER_DROPPED = faults.AMPLIFIER_DROPPED


@njit("void(int64[::1], float64[::1], int64[::1], int64, int64, float64, float64)", inline=True, counted=False)
def raise_fault(
    control: NDArray[Any],
    snapshot: NDArray[Any],
    ints: NDArray[Any],
    tick: int,
    number: int,
    value: float,
    limit: float,
) -> None:
    """Latch a fault; the first one is kept, later ones are its consequences."""
    if ints[W_STATE] == FAULT:
        return
    ints[W_STATE] = FAULT
    snapshot[S_FAULT_VALUE] = value
    snapshot[S_FAULT_LIMIT] = limit
    control[C_FAULT_TICK] = tick
    atomic_store(control, C_FAULT_CODE, number)
    atomic_store(control, C_STATE, FAULT)


@njit("void(int64[::1], float64[::1], int64[::1], int64, int64, int64)", inline=True, counted=False)
def check_exchange(
    control: NDArray[Any], snapshot: NDArray[Any], ints: NDArray[Any], tick: int, result: int, device_code: int
) -> None:
    """Fault on a driver's return value other than OK (0) and MISSED (1)."""
    if result == 2:
        raise_fault(control, snapshot, ints, tick, _DEVICE_FAULT, device_code, 0.0)
    elif result == -1:
        raise_fault(control, snapshot, ints, tick, _DRIVER_ERROR, result, 0.0)
    elif result < -1 or result > 2:
        raise_fault(control, snapshot, ints, tick, _DRIVER_LOST, result, 0.0)


@njit(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], int64, int64, int64, int64)",
    inline=True,
    counted=False,
)
def take_counts(
    params: NDArray[Any],
    control: NDArray[Any],
    snapshot: NDArray[Any],
    ints: NDArray[Any],
    floats: NDArray[Any],
    tick: int,
    now_ns: int,
    counts: int,
    missed: int,
) -> None:
    """Accept a fresh sample: speed from the time that really passed, then jump, over-speed and excursion."""
    watching = params[P_SAFETY] > 0.0 and ints[W_STATE] == RUNNING
    if ints[W_HAVE_COUNTS] == 1:
        moved = counts - ints[W_COUNTS]
        elapsed = max(now_ns - ints[W_COUNTS_NS], int(0.5 * params[P_PERIOD_NS]))
        floats[V_SPEED] = moved * 1e9 / elapsed
        if watching:
            # A later sample may have moved further: the limit is per period that passed.
            periods = 1 + missed + ints[W_MISSED_IN_A_ROW]
            if abs(moved) > params[P_ENCODER_JUMP] * periods:
                raise_fault(control, snapshot, ints, tick, _ENCODER_JUMP, moved, params[P_ENCODER_JUMP])
            elif abs(floats[V_SPEED]) > params[P_MAX_SPEED]:
                scale = params[P_RAW_RESOLUTION]
                raise_fault(
                    control, snapshot, ints, tick, _OVER_SPEED, floats[V_SPEED] * scale, params[P_MAX_SPEED] * scale
                )
    if watching:
        excursion = counts - params[P_ORIGIN]
        if abs(excursion) > params[P_MAX_EXCURSION]:
            scale = params[P_RAW_RESOLUTION]
            raise_fault(control, snapshot, ints, tick, _EXCURSION, excursion * scale, params[P_MAX_EXCURSION] * scale)
    ints[W_COUNTS] = counts
    ints[W_COUNTS_NS] = now_ns
    ints[W_HAVE_COUNTS] = 1


@njit(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], int64, int64)", inline=True, counted=False
)
def check_load(
    params: NDArray[Any],
    control: NDArray[Any],
    snapshot: NDArray[Any],
    ints: NDArray[Any],
    floats: NDArray[Any],
    tick: int,
    missed: int,
) -> None:
    """Late ticks, missed exchanges, and the I²t of the current that flowed since the last tick."""
    ints[W_OVERRUNS_IN_A_ROW] = ints[W_OVERRUNS_IN_A_ROW] + 1 if missed > 0 else 0
    if params[P_SAFETY] == 0.0:
        return
    if ints[W_STATE] == RUNNING:
        overruns = ints[W_OVERRUNS_IN_A_ROW]
        allowed = 1.0 if params[P_OVERRUN_POLICY] == FAULT_ON_OVERRUN else params[P_OVERRUN_FAULT_AFTER]
        if overruns >= allowed:
            raise_fault(control, snapshot, ints, tick, _OVERRUN, overruns, allowed)
    if ints[W_MISSED_IN_A_ROW] > params[P_MISSED_EXCHANGES]:
        raise_fault(
            control, snapshot, ints, tick, _MISSED_EXCHANGES, ints[W_MISSED_IN_A_ROW], params[P_MISSED_EXCHANGES]
        )
    continuous = params[P_CONTINUOUS_CURRENT]
    if np.isfinite(continuous):
        seconds = params[P_PERIOD_NS] * 1e-9 * (1 + missed)
        floats[V_I2T] = max(0.0, floats[V_I2T] + (floats[V_CURRENT] ** 2 - continuous**2) * seconds)
        snapshot[S_I2T] = floats[V_I2T]
        limit = params[P_I2T_LIMIT]
        if floats[V_I2T] > limit:
            raise_fault(control, snapshot, ints, tick, _OVER_CURRENT, floats[V_I2T], limit)


@njit("void(int64[::1], float64[::1])", inline=True, counted=False)
def forget_motion(ints: NDArray[Any], floats: NDArray[Any]) -> None:
    """Start counting afresh: nothing that happened before a (re)start may trip a limit or be commanded."""
    ints[W_HAVE_COUNTS] = 0
    ints[W_MISSED_IN_A_ROW] = 0
    ints[W_OVERRUNS_IN_A_ROW] = 0
    ints[W_FIFO_HEAD] = 0
    ints[W_FIFO_TAIL] = 0
    floats[V_SPEED] = 0.0


@njit(
    "void(float64[::1], int64[::1], float64[::1], int64[::1], float64[::1], int64, int64, boolean, boolean, boolean)",
    inline=True,
    counted=False,
)
def step_state(
    params: NDArray[Any],
    control: NDArray[Any],
    snapshot: NDArray[Any],
    ints: NDArray[Any],
    floats: NDArray[Any],
    tick: int,
    now_ns: int,
    enabled: bool,
    fresh: bool,
    real_time: bool,
) -> None:
    """One step of the state machine: clear, estop, heartbeat, then what the supervisor requests.

    Args:
        params, control, snapshot, ints, floats: the loop's shared words (see :mod:`hapticd.servo.layout`).
        tick: present tick. now_ns: present time in ns.
        enabled: the amplifier's own word, from the last good exchange. fresh: whether that is this tick's.
        real_time: False in virtual time, where no supervisor is alive.
    """
    clear = int(params[P_CLEAR])
    if clear != ints[W_CLEAR]:
        ints[W_CLEAR] = clear
        if ints[W_STATE] == FAULT:
            ints[W_STATE] = OFF
            forget_motion(ints, floats)
            atomic_store(control, C_FAULT_CODE, 0)
    stops = atomic_load(control, C_ESTOP)
    if stops != ints[W_ESTOP]:
        ints[W_ESTOP] = stops
        raise_fault(control, snapshot, ints, tick, _ESTOP, 0.0, 0.0)
    if real_time and params[P_HEARTBEAT_NS] > 0.0:
        silence = now_ns - atomic_load(control, C_HEARTBEAT_NS)
        if silence > params[P_HEARTBEAT_NS]:
            raise_fault(control, snapshot, ints, tick, _HEARTBEAT_LOST, silence * 1e-6, params[P_HEARTBEAT_NS] * 1e-6)
    state = ints[W_STATE]
    if state == FAULT:
        return
    request = int(params[P_REQUEST])
    if request == OFF:
        state = OFF
    elif state == OFF:
        state = READY
        ints[W_REQUEST_NS] = now_ns
    elif state == READY:
        if enabled and fresh and request == RUNNING:
            state = RUNNING
            forget_motion(ints, floats)
        elif not enabled and now_ns - ints[W_REQUEST_NS] > params[P_ENABLE_TIMEOUT_NS]:
            limit = params[P_ENABLE_TIMEOUT_NS] * 1e-9
            raise_fault(control, snapshot, ints, tick, _ENABLE_TIMEOUT, limit, limit)
            return
    elif not enabled:
        raise_fault(control, snapshot, ints, tick, _AMPLIFIER_DROPPED, 0.0, 0.0)
        return
    elif request == READY:
        state = READY
    ints[W_STATE] = state
    atomic_store(control, C_STATE, state)
