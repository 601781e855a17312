"""From the current that is asked for to the driver: DAC grid, the delay T_V, and the way out through zero."""

from __future__ import annotations

from typing import Any

import numba
from numpy.typing import NDArray

from drivers.interface import X_CODE, X_CURRENT, X_ENABLE, X_TIME_FRAC, X_TIME_NS
from hapticd.jit import call_driver, njit
from hapticd.plant.amplifier import dac_quantise
from hapticd.record.schema import FLAG_SATURATED
from hapticd.servo import layout as w
from hapticd.servo.clock import later, now_ns, sleep_until

_FIFO_MASK = w.FIFO_LENGTH - 1
_HALF_NS = 0.5
LAST_WRITE_ATTEMPTS = 3

_I = numba.types.Array(numba.int64, 1, "C")
_F = numba.types.Array(numba.float64, 1, "C")
_F2 = numba.types.Array(numba.float64, 2, "C")
_i = numba.int64
_f = numba.float64


@njit(_i(_F, _F, _I, _F, _I, _f, _i, _f, _i), inline=True, counted=False)
def write(
    params: NDArray[Any],
    floats: NDArray[Any],
    exchange: NDArray[Any],
    exchange_floats: NDArray[Any],
    pointers: NDArray[Any],
    current: float,
    ns: int,
    frac: float,
    enable: int,
) -> int:
    """Put a current on the DAC's grid and hand it to the driver at (ns, frac); returns the driver's word."""
    quantised, code = dac_quantise(current, int(params[w.P_DAC_BITS]), params[w.P_DAC_FULL_SCALE])
    exchange[X_TIME_NS] = ns
    exchange_floats[X_TIME_FRAC] = frac
    exchange_floats[X_CURRENT] = quantised
    exchange[X_CODE] = code
    exchange[X_ENABLE] = enable
    floats[w.V_CURRENT] = quantised
    return call_driver(pointers[1], pointers[2], pointers[3])


@njit(_i(_F, _I, _F, _I, _F, _I, _i), inline=True, counted=False)
def write_zero(
    params: NDArray[Any],
    ints: NDArray[Any],
    floats: NDArray[Any],
    exchange: NDArray[Any],
    exchange_floats: NDArray[Any],
    pointers: NDArray[Any],
    ns: int,
) -> int:
    """Zero current; the amplifier stays on for this one write, and is switched off by the next."""
    ints[w.W_FIFO_HEAD] = 0
    ints[w.W_FIFO_TAIL] = 0
    floats[w.V_REQUESTED] = 0.0
    floats[w.V_FORCE] = 0.0
    ready = ints[w.W_STATE] == w.READY
    enable = 1 if ready or ints[w.W_ENABLED] == w.ENABLED_WITH_CURRENT else 0
    ints[w.W_ENABLED] = w.ENABLED_AT_ZERO if enable == 1 else w.DISABLED
    return write(params, floats, exchange, exchange_floats, pointers, 0.0, ns, 0.0, enable)


@njit(numba.void(_F, _I, _F, _I, _F, _I, _i), inline=True, counted=False)
def leave(
    params: NDArray[Any],
    ints: NDArray[Any],
    floats: NDArray[Any],
    exchange: NDArray[Any],
    exchange_floats: NDArray[Any],
    pointers: NDArray[Any],
    ns: int,
) -> None:
    """The loop's way out: zero current first, then amplifier off, each tried again when the exchange fails."""
    for enable in (1, 0):
        if enable == 1 and ints[w.W_ENABLED] == w.DISABLED:
            continue
        for _ in range(LAST_WRITE_ATTEMPTS):
            if write(params, floats, exchange, exchange_floats, pointers, 0.0, ns, 0.0, enable) == 0:
                break
    ints[w.W_ENABLED] = w.DISABLED


@njit(
    numba.types.UniTuple(_i, 3)(_F, _I, _F, _I, _F2, _I, _F, _I, _I, _i, _f, numba.boolean), inline=True, counted=False
)
def write_current(
    params: NDArray[Any],
    ints: NDArray[Any],
    floats: NDArray[Any],
    fifo_ns: NDArray[Any],
    fifo: NDArray[Any],
    exchange: NDArray[Any],
    exchange_floats: NDArray[Any],
    pointers: NDArray[Any],
    timespec: NDArray[Any],
    ns: int,
    frac: float,
    real_time: bool,
) -> tuple[int, int, int]:
    """Write ``floats[V_REQUESTED]`` after T_V: at once, or whatever of the waiting commands falls due in this period.

    Returns:
        The driver's last word, ns spent waiting for due times, and FLAG_SATURATED or 0.
    """
    ints[w.W_ENABLED] = w.ENABLED_WITH_CURRENT
    requested = floats[w.V_REQUESTED]
    if params[w.P_DELAY_NS] < _HALF_NS and ints[w.W_FIFO_HEAD] == ints[w.W_FIFO_TAIL]:
        at = now_ns(timespec) if real_time else ns
        result = write(
            params, floats, exchange, exchange_floats, pointers, requested, at, 0.0 if real_time else frac, 1
        )
        saturated = abs(floats[w.V_CURRENT] - requested) > params[w.P_DAC_STEP]
        return result, 0, FLAG_SATURATED if saturated else 0

    head = ints[w.W_FIFO_HEAD]
    if head - ints[w.W_FIFO_TAIL] < w.FIFO_LENGTH:
        slot = head & _FIFO_MASK
        fifo_ns[slot], fifo[0, slot] = later(ns, frac, params[w.P_DELAY_NS])
        fifo[1, slot] = requested
        ints[w.W_FIFO_HEAD] = head + 1
    waited = 0
    result = 0
    flags = 0
    writes = 0
    while ints[w.W_FIFO_TAIL] < ints[w.W_FIFO_HEAD] and (result == 0 or result == 1):
        slot = ints[w.W_FIFO_TAIL] & _FIFO_MASK
        due_in = (fifo_ns[slot] - ns) + (fifo[0, slot] - frac)
        if due_in >= params[w.P_PERIOD_NS] - _HALF_NS:
            break
        ints[w.W_FIFO_TAIL] += 1
        following = ints[w.W_FIFO_TAIL] & _FIFO_MASK
        if ints[w.W_FIFO_TAIL] < ints[w.W_FIFO_HEAD] and (fifo_ns[following] - ns) + (fifo[0, following] - frac) <= 0.0:
            continue  # after missed periods: a later command is overdue too, this one has had its day
        at, at_frac = fifo_ns[slot], fifo[0, slot]
        if real_time:
            begin = now_ns(timespec)
            at = begin
            if fifo_ns[slot] > begin:
                sleep_until(timespec, fifo_ns[slot])
                at = now_ns(timespec)
                waited += at - begin
            at_frac = 0.0
        result = write(params, floats, exchange, exchange_floats, pointers, fifo[1, slot], at, at_frac, 1)
        if abs(floats[w.V_CURRENT] - fifo[1, slot]) > params[w.P_DAC_STEP]:
            flags = FLAG_SATURATED
        writes += 1
    if writes == 0:
        # Nothing is due, but a device with a watchdog wants to hear from us every tick.
        at = now_ns(timespec) if real_time else ns
        result = write(
            params, floats, exchange, exchange_floats, pointers, floats[w.V_CURRENT], at, 0.0 if real_time else frac, 1
        )
    return result, waited, flags
