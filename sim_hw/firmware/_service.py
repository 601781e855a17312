"""The test bench's compiled service: bytes between port and board, faults of the line, and the plant."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from hapticd.jit import atomic_load, njit
from sim_hw import kinds, log
from sim_hw import layout as w
from sim_hw._clock import POLLHUP, POLLIN, monotonic_ns, pollfd, read, returned_events, wait_readable, write
from sim_hw._faults import begin_fault, pass_frame, random_bits
from sim_hw._held import next_held, release, take
from sim_hw._motion import end_sample, log_row
from sim_hw.firmware._layout import BOARD, BOARD_LENGTH, FRAMED, GLITCH_SHOWN
from sim_hw.firmware._output import show_inputs, take_outputs
from sim_hw.layout import BYTES, I64, SIM, Sim
from sim_hw.serial_board import layout as b
from sim_hw.serial_board.framing import LONGEST_FRAME, decode, encode
from sim_hw.serial_board.layout import LINE, Line, next_due_ns

STOPPED, UNPLUG, PLUG_IN, POWER_OFF, POWER_ON, BOARD_GONE = range(6)
"""Reasons to return."""

_SAMPLE, _COMMAND, _SAMPLE_INPUTS = 0x03, 0x04, 0x05
_HELLO_REPLY, _SAMPLE_REPLY = 0x81, 0x83
_LOOK_NS = 200_000
"""Period of polling the board's outputs, which have no interrupt."""
_CLOSED_LOOK_NS = 2_000_000


@njit((SIM, LINE, BYTES, I64, I64, I64), counted=False)
def _pass_on(sim: Sim, line: Line, data: NDArray[Any], size: int, frame: int, ns: int) -> None:
    """Write bytes of a frame of this kind to its receiver; before a SAMPLE the board's counter is updated."""
    if frame == kinds.REPLY:
        if sim.s[b.LINE_OPEN] == 1 and sim.s[w.SILENT_UNTIL_NS] <= ns:
            write(sim.s[b.MASTER], data.ctypes.data, size)
    elif sim.s[BOARD] >= 0:
        take_outputs(sim, line, ns)
        show_inputs(sim, line, ns)
        write(sim.s[BOARD], data.ctypes.data, size)


@njit((SIM, LINE, BYTES, I64, I64, I64), counted=False)
def _decide(sim: Sim, line: Line, raw: NDArray[Any], size: int, frame: int, ns: int) -> None:
    """Apply faults to the complete frame in ``raw``, with its delimiter, and forward it, now or later."""
    copies, _ = pass_frame(sim, frame, raw, size, ns, ns)
    for _ in range(copies):
        _pass_on(sim, line, raw, size, frame, ns)
        release(sim, frame, ns)


@njit((SIM, LINE, I64, I64), counted=False)
def _from_host(sim: Sim, line: Line, size: int, ns: int) -> None:
    """Process bytes in the buffer from the host."""
    framed = sim.s[FRAMED] == 1
    if not framed:
        _pass_on(sim, line, line.buffer, size, kinds.REQUEST, ns)
    for n in range(size):
        length = sim.s[b.RAW_LENGTH]
        if length <= LONGEST_FRAME:
            line.raw[length] = line.buffer[n]
        sim.s[b.RAW_LENGTH] = length + 1
        if line.buffer[n] != 0:
            continue
        sim.s[b.RAW_LENGTH] = 0
        found = decode(line.raw, length, line.payload)
        if found == 2 and (line.payload[0] == _SAMPLE or line.payload[0] == _SAMPLE_INPUTS):
            sim.s[GLITCH_SHOWN] = 1 if sim.s[w.GLITCH_LEFT] > 0 else 0
            log_row(sim, ns, log.SAMPLE, int(line.payload[1]), -1)
        if framed and length <= LONGEST_FRAME:
            frame = kinds.COMMAND if found > 0 and line.payload[0] == _COMMAND else kinds.REQUEST
            _decide(sim, line, line.raw, length + 1, frame, ns)


@njit((SIM, LINE, I64, I64), counted=False)
def _from_board(sim: Sim, line: Line, size: int, ns: int) -> None:
    """Process bytes in the buffer from the board, which only sends frames."""
    for n in range(size):
        length = sim.s[BOARD_LENGTH]
        if length < w.HELD_BYTES:
            line.reply[length] = line.buffer[n]
        sim.s[BOARD_LENGTH] = min(length + 1, w.HELD_BYTES)
        if line.buffer[n] != 0:
            continue
        sim.s[BOARD_LENGTH] = 0
        found = decode(line.reply, length, line.payload)
        if found > 0 and line.payload[0] >= _SAMPLE_REPLY and sim.s[GLITCH_SHOWN] == 1:
            sim.s[GLITCH_SHOWN] = 0
            end_sample(sim)
        if found > 0 and line.payload[0] == _HELLO_REPLY and sim.s[b.VERSION] >= 0:
            line.payload[1] = sim.s[b.VERSION]
            encode(line.payload, found, line.reply)
        _decide(sim, line, line.reply, length + 1, kinds.REPLY, ns)


@njit((SIM, LINE, I64), counted=False)
def _let_go(sim: Sim, line: Line, slot: int) -> None:
    """Forward a held frame."""
    due = sim.held[slot, w.HELD_DUE_NS]
    frame = sim.held[slot, w.HELD_FRAME]
    _pass_on(sim, line, line.wire, take(sim, slot, line.wire), frame, due)
    release(sim, frame, due)


@njit(I64(SIM, LINE), counted=False)
def _begin(sim: Sim, line: Line) -> int:
    """Begin the next fault; returns a reason to return, or STOPPED to continue."""
    kind, row, due, until = begin_fault(sim)
    if kind == kinds.GARBAGE:
        size = min(sim.faults[row, w.FAULT_SIZE], b.BUFFER_BYTES)
        for n in range(size):
            line.buffer[n] = random_bits(sim) & 0xFF
        _pass_on(sim, line, line.buffer, size, kinds.REPLY, due)
    elif kind == kinds.REBOOT:
        sim.s[b.RESET_UNTIL_NS] = until
        return POWER_OFF
    elif kinds.ENCODER_FAULT <= kind <= kinds.EXTERNAL_STOP:
        sim.s[b.CAUSE_UNTIL_NS + kind - kinds.ENCODER_FAULT] = until
    elif kind == kinds.UNPLUG:
        sim.s[b.PLUG_IN_NS] = until
        return UNPLUG
    return STOPPED


@njit(I64(SIM, LINE, I64), counted=False)
def _do_due(sim: Sim, line: Line, now: int) -> int:
    """Do everything that is due, in order; returns a reason to return, or STOPPED to continue."""
    take_outputs(sim, line, now)
    due = next_due_ns(sim)
    while due <= now:
        slot, held_ns = next_held(sim)
        if due == sim.s[b.PLUG_IN_NS]:
            sim.s[b.PLUG_IN_NS] = w.FAR_NS
            return PLUG_IN
        if due == sim.s[b.RESET_UNTIL_NS]:
            sim.s[b.RESET_UNTIL_NS] = w.FAR_NS
            return POWER_ON
        if due == held_ns:
            _let_go(sim, line, slot)
        else:
            reason = _begin(sim, line)
            if reason != STOPPED:
                return reason
        due = next_due_ns(sim)
    show_inputs(sim, line, now)
    return STOPPED


@njit(I64(SIM, LINE), counted=False)
def serve(sim: Sim, line: Line) -> int:
    """Run the test bench until STOP is set (STOPPED), or until there is work for Python."""
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
        wait = min(next_due_ns(sim) - now, _LOOK_NS if is_open else _CLOSED_LOOK_NS)
        line.pollfds[0] = pollfd(sim.s[BOARD], POLLIN)
        line.pollfds[1] = pollfd(sim.s[b.MASTER], POLLIN)
        interrupted = wait_readable(line.pollfds, 2 if is_open else 1, line.timespec, wait) < 0
        if not is_open and not interrupted:
            wait_readable(line.pollfds, 2, line.timespec, 0)
        now = monotonic_ns(line.timespec)
        if interrupted:
            continue
        reason = _do_due(sim, line, now)
        if reason != STOPPED:
            return reason
        board, host = returned_events(line.pollfds[0]), returned_events(line.pollfds[1])
        if board != 0 and sim.s[BOARD] >= 0:
            size = read(sim.s[BOARD], line.buffer.ctypes.data, b.BUFFER_BYTES)
            if size == 0:
                return BOARD_GONE
            _from_board(sim, line, size, now)
        if sim.s[b.MASTER] >= 0:
            sim.s[b.LINE_OPEN] = 0 if host & POLLHUP and host & POLLIN == 0 else 1
        if host & POLLIN:
            size = read(sim.s[b.MASTER], line.buffer.ctypes.data, b.BUFFER_BYTES)
            _from_host(sim, line, size, now)
