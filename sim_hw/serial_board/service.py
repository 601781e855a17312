"""The board's compiled service: waits for bytes and events, and processes each at its instant."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from hapticd.jit import atomic_load, njit
from sim_hw import kinds, log
from sim_hw import layout as w
from sim_hw._clock import POLLHUP, POLLIN, monotonic_ns, pollfd, read, returned_events, wait_readable
from sim_hw._faults import begin_fault, pass_frame
from sim_hw._held import next_held, release, take
from sim_hw._motion import log_row, move_to
from sim_hw.layout import BYTES, I64, SIM, Sim
from sim_hw.serial_board import layout as b
from sim_hw.serial_board._board import handle, latch_fault, let_go, power_up, reboot, trip_watchdog
from sim_hw.serial_board._sending import put_on_line, send_garbage
from sim_hw.serial_board.framing import LONGEST_FRAME, decode
from sim_hw.serial_board.layout import LINE, Line, next_due_ns

STOPPED, UNPLUG, PLUG_IN = 0, 1, 2
"""Reasons to return."""

_LONGEST_WAIT_NS = 20_000_000
_CLOSED_WAIT_NS = 2_000_000


@njit((SIM, LINE, BYTES, I64, I64), counted=False)
def _act(sim: Sim, line: Line, frame: NDArray[Any], size: int, ns: int) -> None:
    """Process a received frame of ``size`` bytes, with its delimiter."""
    length = decode(frame, size - 1, line.payload)
    if length < 0 or not handle(sim, line, length, ns):
        move_to(sim, ns)
        sim.s[b.STATUS] |= b.BAD_FRAME
        log_row(sim, ns, log.STATE, sim.s[b.STATUS], b.DROPPED_FRAME)


@njit((SIM, LINE, I64), counted=False)
def _receive(sim: Sim, line: Line, ns: int) -> None:
    """Process a complete frame now, or when a fault or the line releases it."""
    length = sim.s[b.RAW_LENGTH]
    sim.s[b.RAW_LENGTH] = 0
    if length == 0:
        return
    line.raw[length] = 0
    is_command = decode(line.raw, length, line.payload) > 0 and line.payload[0] == 0x04
    kind = kinds.COMMAND if is_command else kinds.REQUEST
    due = max(ns, sim.s[b.RECEIVING_UNTIL_NS])
    copies, _ = pass_frame(sim, kind, line.raw, length + 1, due, ns)
    for _ in range(copies):
        _act(sim, line, line.raw, length + 1, ns)
        release(sim, kind, ns)


@njit((SIM, LINE, I64, I64), counted=False)
def _take_bytes(sim: Sim, line: Line, size: int, ns: int) -> None:
    for n in range(size):
        if sim.s[b.BYTE_NS] > 0:
            sim.s[b.RECEIVING_UNTIL_NS] = max(ns, sim.s[b.RECEIVING_UNTIL_NS]) + sim.s[b.BYTE_NS]
        if line.buffer[n] == 0:
            _receive(sim, line, ns)
        else:
            length = sim.s[b.RAW_LENGTH]
            if length < LONGEST_FRAME:
                line.raw[length] = line.buffer[n]
            sim.s[b.RAW_LENGTH] = min(length + 1, LONGEST_FRAME + 1)


@njit((SIM, LINE, I64), counted=False)
def _let_go(sim: Sim, line: Line, slot: int) -> None:
    """Forward a held frame: to the host, or to the board."""
    due = sim.held[slot, w.HELD_DUE_NS]
    frame = sim.held[slot, w.HELD_FRAME]
    size = take(sim, slot, line.wire)
    if frame == kinds.REPLY:
        put_on_line(sim, line, size, due)
    else:
        _act(sim, line, line.wire, size, due)
        release(sim, frame, due)


@njit(I64(SIM, LINE), counted=False)
def _begin(sim: Sim, line: Line) -> int:
    """Begin the next fault; returns a reason to return, or STOPPED to continue."""
    kind, row, due, until = begin_fault(sim)
    if kind == kinds.GARBAGE:
        send_garbage(sim, line, sim.faults[row, w.FAULT_SIZE])
    elif kind == kinds.REBOOT:
        reboot(sim, due, until)
    elif kinds.ENCODER_FAULT <= kind <= kinds.EXTERNAL_STOP:
        latch_fault(sim, due, kind - kinds.ENCODER_FAULT, until)
    elif kind == kinds.RELEASED:
        let_go(sim, due)
    elif kind == kinds.UNPLUG:
        sim.s[b.PLUG_IN_NS] = until
        return UNPLUG
    return STOPPED


@njit(I64(SIM, LINE, I64), counted=False)
def _do_due(sim: Sim, line: Line, now: int) -> int:
    """Do everything that is due, in order; returns a reason to return, or STOPPED to continue."""
    due = next_due_ns(sim)
    while due <= now:
        slot, held_ns = next_held(sim)
        if due == sim.s[b.PLUG_IN_NS]:
            sim.s[b.PLUG_IN_NS] = w.FAR_NS
            return PLUG_IN
        if due == held_ns:
            _let_go(sim, line, slot)
        elif due == sim.s[b.WATCHDOG_DUE_NS]:
            trip_watchdog(sim, due)
        elif due == sim.s[b.RESET_UNTIL_NS]:
            power_up(sim, due)
        else:
            reason = _begin(sim, line)
            if reason != STOPPED:
                return reason
        due = next_due_ns(sim)
    move_to(sim, now)
    return STOPPED


@njit((SIM, I64, I64), counted=False)
def _note_line(sim: Sim, now: int, is_open: int) -> None:
    if sim.s[b.LINE_OPEN] != is_open:
        sim.s[b.LINE_OPEN] = is_open
        sim.s[b.RAW_LENGTH] = 0
        log_row(sim, now, log.STATE, sim.s[b.STATUS], b.OPENED if is_open == 1 else b.CLOSED)


@njit(I64(SIM, LINE), counted=False)
def serve(sim: Sim, line: Line) -> int:
    """Run the board until STOP is set (STOPPED), or the cable is unplugged or plugged in (UNPLUG, PLUG_IN)."""
    now = monotonic_ns(line.timespec)
    while True:
        reason = _do_due(sim, line, now)
        if reason != STOPPED:
            return reason
        if atomic_load(sim.s, w.STOP) != 0:
            return STOPPED
        # A port that no host has open reports POLLHUP permanently: it is polled at intervals.
        is_open = sim.s[b.LINE_OPEN] == 1
        now = monotonic_ns(line.timespec)
        wait = min(next_due_ns(sim) - now, _LONGEST_WAIT_NS if is_open else _CLOSED_WAIT_NS)
        line.pollfds[0] = pollfd(sim.s[b.MASTER], POLLIN)
        if not is_open:
            wait_readable(line.pollfds, 0, line.timespec, wait)
            wait = 0
        interrupted = wait_readable(line.pollfds, 1, line.timespec, wait) < 0
        now = monotonic_ns(line.timespec)
        if interrupted:
            continue
        events = returned_events(line.pollfds[0])
        if events & POLLIN == 0:
            if sim.s[b.MASTER] >= 0:
                _note_line(sim, now, 0 if events & POLLHUP else 1)
            continue
        # Bytes found when this process wakes up after the watchdog's time count as received in time, because a real
        # board would have been awake. Every other due event comes before them.
        now = min(now, max(sim.s[b.WATCHDOG_DUE_NS] - 1, 0))
        reason = _do_due(sim, line, now)
        if reason != STOPPED:
            return reason
        size = read(sim.s[b.MASTER], line.buffer.ctypes.data, b.BUFFER_BYTES)
        if size > 0:
            _note_line(sim, now, 1)
            if sim.s[b.RESET_UNTIL_NS] == w.FAR_NS:
                _take_bytes(sim, line, size, now)
