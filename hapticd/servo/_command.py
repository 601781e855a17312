"""From the requested current to the driver: DAC grid, delay T_V, shutdown with zero current."""

from __future__ import annotations

from typing import Any

from hapticd.jit import call_driver, njit
from hapticd.plant.amplifier import quantise_current
from hapticd.record.schema import FLAG_SATURATED
from hapticd.servo.clock import later, now_ns, sleep_until
from hapticd.servo.layout import DISABLED, ENABLED_AT_ZERO, ENABLED_WITH_CURRENT, MOST_DELAYED, READY

_MASK = MOST_DELAYED - 1
_HALF_NS = 0.5
LAST_WRITE_ATTEMPTS = 3


@njit(inline=True, counted=False)
def present(servo: Any) -> tuple[int, float]:
    """The present instant: of the clock, or in virtual time of the tick."""
    if servo.real_time:
        return now_ns(servo.timespec), 0.0
    return servo.tick.woke_ns, servo.tick.frac


@njit(inline=True, counted=False)
def write(servo: Any, current: float, ns: int, frac: float, enable: int) -> int:
    """Round a current to the DAC's grid and pass it to the driver at (ns, frac); returns the driver's code."""
    exchange, driver = servo.exchange, servo.driver
    quantised, code = quantise_current(current, servo.params.dac_step, servo.params.dac_max_code)
    exchange.time_ns = ns
    exchange.time_frac = frac
    exchange.current = quantised
    exchange.code = code
    exchange.enable = enable
    servo.state.current = quantised
    return call_driver(driver.write, driver.state, driver.exchange)


@njit(inline=True, counted=False)
def write_zero(servo: Any) -> int:
    """Write zero current; the amplifier stays on for this write and is switched off by the next."""
    state = servo.state
    state.delayed_head = 0
    state.delayed_tail = 0
    state.requested = 0.0
    state.force = 0.0
    enable = 1 if state.mode == READY or state.amplifier == ENABLED_WITH_CURRENT else 0
    state.amplifier = ENABLED_AT_ZERO if enable == 1 else DISABLED
    ns, _ = present(servo)
    return write(servo, 0.0, ns, 0.0, enable)


@njit(inline=True, counted=False)
def leave(servo: Any) -> None:
    """End the loop: zero current, then amplifier off; each is repeated if the exchange fails."""
    for enable in (1, 0):
        if enable == 1 and servo.state.amplifier == DISABLED:
            continue
        for _ in range(LAST_WRITE_ATTEMPTS):
            if write(servo, 0.0, servo.tick.woke_ns, 0.0, enable) == 0:
                break
    servo.state.amplifier = DISABLED


@njit(inline=True, counted=False)
def write_at(servo: Any, current: float, ns: int, frac: float) -> int:
    """Write a requested current; if the converter is at the end of its range, a flag is set in the row."""
    result = write(servo, current, ns, frac, 1)
    if abs(servo.state.current - current) > servo.params.dac_step:
        servo.tick.flags |= FLAG_SATURATED
    return result


@njit(inline=True, counted=False)
def delay(servo: Any) -> None:
    """Queue the rendered current for T_V."""
    state, tick = servo.state, servo.tick
    if state.delayed_head - state.delayed_tail < MOST_DELAYED:
        command = servo.delayed[state.delayed_head & _MASK]
        command.due_ns, command.due_frac = later(tick.ns, tick.frac, servo.params.delay_ns)
        command.current = state.requested
        state.delayed_head += 1


@njit(inline=True, counted=False)
def due_in(servo: Any, number: int) -> float:
    """Time from the tick's grid instant until a waiting command is due, ns."""
    command = servo.delayed[number & _MASK]
    return (command.due_ns - servo.tick.ns) + (command.due_frac - servo.tick.frac)


@njit(counted=False)
def write_due(servo: Any) -> int:
    """Write every waiting command that is due within this period, at its instant; returns the driver's last code."""
    state, tick = servo.state, servo.tick
    result = 0
    is_silent = True
    while state.delayed_tail < state.delayed_head and (result == 0 or result == 1):
        if due_in(servo, state.delayed_tail) >= servo.params.period_ns - _HALF_NS:
            break
        command = servo.delayed[state.delayed_tail & _MASK]
        state.delayed_tail += 1
        if state.delayed_tail < state.delayed_head and due_in(servo, state.delayed_tail) <= 0.0:
            continue  # after missed periods: a later command is overdue too and replaces this one
        ns, frac = command.due_ns, command.due_frac
        if servo.real_time:
            begin = now_ns(servo.timespec)
            ns, frac = begin, 0.0
            if command.due_ns > begin:
                sleep_until(servo.timespec, command.due_ns)
                ns = now_ns(servo.timespec)
                tick.waited_ns += ns - begin
        elif tick.late_ns > 0 and command.due_ns < tick.woke_ns:
            ns, frac = present(servo)  # it was due while the replayed loop slept
        result = write_at(servo, command.current, ns, frac)
        is_silent = False
    if is_silent:
        # Nothing is due, but a device with a watchdog needs a write in every tick.
        ns, frac = present(servo)
        result = write(servo, state.current, ns, frac, 1)
    return result


@njit(inline=True, counted=False)
def write_current(servo: Any) -> int:
    """Write the rendered current after T_V: without a delay at once, else the waiting commands that are due in this period.

    Returns:
        The driver's last return code.
    """
    params, state = servo.params, servo.state
    state.amplifier = ENABLED_WITH_CURRENT
    if params.delay_ns < _HALF_NS and state.delayed_head == state.delayed_tail:
        ns, frac = present(servo)
        return write_at(servo, state.requested, ns, frac)
    delay(servo)
    return write_due(servo)
