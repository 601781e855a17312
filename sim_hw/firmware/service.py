"""The bench's cyclic service, compiled: bytes between port and board, faults on their way, and the shaft."""

from __future__ import annotations

from typing import Any

from numba import types
from numpy.typing import NDArray

from hapticd.jit import atomic_load, njit
from sim_hw import kinds, log
from sim_hw import layout as w
from sim_hw.clock import POLLHUP, POLLIN, monotonic_ns, pollfd, returned_events, wait_readable
from sim_hw.faults import (
    begin_fault,
    corrupt,
    fault_due_ns,
    fault_end_ns,
    frame_fate,
    hold_back,
    next_event_ns,
    next_fault,
    random_bits,
)
from sim_hw.firmware import words as b
from sim_hw.firmware.output import show_inputs, take_outputs
from sim_hw.firmware.words import LINES, Lines
from sim_hw.held import next_held, release, take
from sim_hw.layout import BYTES, I64, SIM, Sim
from sim_hw.motion import end_sample, log_row
from sim_hw.serial_board.framing import LONGEST_FRAME, decode, encode

_read = types.ExternalFunction("read", types.intp(types.intc, types.intp, types.uintp))
_write = types.ExternalFunction("write", types.intp(types.intc, types.intp, types.uintp))

STOPPED, UNPLUG, PLUG_IN, POWER_OFF, POWER_ON, BOARD_GONE = range(6)
"""Why the service returned."""

_SAMPLE, _COMMAND, _HELLO_REPLY, _SAMPLE_REPLY = 0x03, 0x04, 0x81, 0x83
_LOOK_NS = 200_000
"""The board's outputs are looked at so often: no interrupt tells of them."""
_CLOSED_LOOK_NS = 2_000_000


@njit((SIM, LINES, BYTES, I64, I64, I64), counted=False)
def _pass_on(sim: Sim, lines: Lines, data: NDArray[Any], size: int, frame: int, ns: int) -> None:
    """Write bytes of a frame of this kind to the side that it is for; the counter is shown to a SAMPLE first."""
    if frame == kinds.REPLY:
        if sim.s[b.PORT_OPEN] == 1 and sim.s[w.SILENT_UNTIL_NS] <= ns:
            _write(sim.s[b.HOST], data.ctypes.data, size)
    elif sim.s[b.BOARD] >= 0:
        take_outputs(sim, lines, ns)
        show_inputs(sim, lines, ns)
        _write(sim.s[b.BOARD], data.ctypes.data, size)


@njit((SIM, LINES, BYTES, I64, I64, I64), counted=False)
def _decide(sim: Sim, lines: Lines, raw: NDArray[Any], size: int, frame: int, ns: int) -> None:
    """A whole frame stands in ``raw``, its delimiter included: its fate, and on it goes, now or when it is due."""
    fate, delay = frame_fate(sim, frame, ns)
    if fate & kinds.DROPPED:
        return
    if fate & kinds.CORRUPTED:
        corrupt(sim, raw, size - 1)
    copies = 2 if fate & kinds.DUPLICATED else 1
    for _ in range(copies):
        if not hold_back(sim, fate, ns + delay, frame, raw, size, ns):
            _pass_on(sim, lines, raw, size, frame, ns)
            release(sim, frame, ns)


@njit((SIM, LINES, I64, I64), counted=False)
def _from_host(sim: Sim, lines: Lines, size: int, ns: int) -> None:
    """Bytes in the buffer came from the host."""
    framed = sim.s[b.FRAMED] == 1
    if not framed:
        _pass_on(sim, lines, lines.buffer, size, kinds.REQUEST, ns)
    for n in range(size):
        length = sim.s[b.HOST_LENGTH]
        if length <= LONGEST_FRAME:
            lines.from_host[length] = lines.buffer[n]
        sim.s[b.HOST_LENGTH] = length + 1
        if lines.buffer[n] != 0:
            continue
        sim.s[b.HOST_LENGTH] = 0
        found = decode(lines.from_host, length, lines.payload)
        if found == 2 and lines.payload[0] == _SAMPLE:
            sim.s[b.GLITCH_SHOWN] = 1 if sim.s[w.GLITCH_LEFT] > 0 else 0
            log_row(sim, ns, log.SAMPLE, int(lines.payload[1]), -1)
        if framed and length <= LONGEST_FRAME:
            frame = kinds.COMMAND if found > 0 and lines.payload[0] == _COMMAND else kinds.REQUEST
            _decide(sim, lines, lines.from_host, length + 1, frame, ns)


@njit((SIM, LINES, I64, I64), counted=False)
def _from_board(sim: Sim, lines: Lines, size: int, ns: int) -> None:
    """Bytes in the buffer came from the board, which sends nothing but frames."""
    for n in range(size):
        length = sim.s[b.BOARD_LENGTH]
        if length < w.HELD_BYTES:
            lines.from_board[length] = lines.buffer[n]
        sim.s[b.BOARD_LENGTH] = min(length + 1, w.HELD_BYTES)
        if lines.buffer[n] != 0:
            continue
        sim.s[b.BOARD_LENGTH] = 0
        found = decode(lines.from_board, length, lines.payload)
        if found > 0 and lines.payload[0] == _SAMPLE_REPLY and sim.s[b.GLITCH_SHOWN] == 1:
            sim.s[b.GLITCH_SHOWN] = 0
            end_sample(sim)
        if found > 0 and lines.payload[0] == _HELLO_REPLY and sim.s[b.VERSION] >= 0:
            lines.payload[1] = sim.s[b.VERSION]
            encode(lines.payload, found, lines.from_board)
        _decide(sim, lines, lines.from_board, length + 1, kinds.REPLY, ns)


@njit((SIM, LINES, I64), counted=False)
def _let_go(sim: Sim, lines: Lines, slot: int) -> None:
    """A frame that was held goes on."""
    due = sim.held[slot, w.HELD_DUE_NS]
    frame = sim.held[slot, w.HELD_FRAME]
    _pass_on(sim, lines, lines.wire, take(sim, slot, lines.wire), frame, due)
    release(sim, frame, due)


@njit(I64(SIM, LINES), counted=False)
def _begin(sim: Sim, lines: Lines) -> int:
    """The next fault falls due; the service's reason to return, or STOPPED to go on."""
    row = next_fault(sim)
    due = fault_due_ns(sim, row)
    until = fault_end_ns(sim, row, due)
    kind = begin_fault(sim, row)
    if kind == kinds.GARBAGE:
        size = min(sim.faults[row, w.FAULT_SIZE], b.BUFFER_BYTES)
        for n in range(size):
            lines.buffer[n] = random_bits(sim) & 0xFF
        _pass_on(sim, lines, lines.buffer, size, kinds.REPLY, due)
    elif kind == kinds.REBOOT:
        sim.s[b.OFF_UNTIL_NS] = until
        return POWER_OFF
    elif kinds.ENCODER_FAULT <= kind <= kinds.EXTERNAL_STOP:
        sim.s[b.CAUSE_UNTIL_NS + kind - kinds.ENCODER_FAULT] = until
    elif kind == kinds.UNPLUG:
        sim.s[b.PLUG_IN_NS] = until
        return UNPLUG
    return STOPPED


@njit(I64(SIM), counted=False)
def _next_due_ns(sim: Sim) -> int:
    """Instant of the next thing that happens without either side: FAR_NS for none."""
    return min(sim.s[b.OFF_UNTIL_NS], sim.s[b.PLUG_IN_NS], next_event_ns(sim))


@njit(I64(SIM, LINES, I64), counted=False)
def _do_due(sim: Sim, lines: Lines, now: int) -> int:
    """Everything that is due by now, in order; the service's reason to return, or STOPPED to go on."""
    take_outputs(sim, lines, now)
    due = _next_due_ns(sim)
    while due <= now:
        slot = next_held(sim)
        if due == sim.s[b.PLUG_IN_NS]:
            sim.s[b.PLUG_IN_NS] = w.FAR_NS
            return PLUG_IN
        if due == sim.s[b.OFF_UNTIL_NS]:
            sim.s[b.OFF_UNTIL_NS] = w.FAR_NS
            return POWER_ON
        if slot >= 0 and sim.held[slot, w.HELD_DUE_NS] == due:
            _let_go(sim, lines, slot)
        else:
            reason = _begin(sim, lines)
            if reason != STOPPED:
                return reason
        due = _next_due_ns(sim)
    show_inputs(sim, lines, now)
    return STOPPED


@njit(I64(SIM, LINES), counted=False)
def serve(sim: Sim, lines: Lines) -> int:
    """Be the bench until STOP is set (STOPPED), or something is to be done that needs Python."""
    now = monotonic_ns(lines.timespec)
    while True:
        reason = _do_due(sim, lines, now)
        if reason != STOPPED:
            return reason
        if atomic_load(sim.s, w.STOP) != 0:
            return STOPPED
        # A port that nobody has open hangs up without end: it is looked at now and then, not waited for.
        is_open = sim.s[b.PORT_OPEN] == 1
        now = monotonic_ns(lines.timespec)
        wait = min(_next_due_ns(sim) - now, _LOOK_NS if is_open else _CLOSED_LOOK_NS)
        lines.pollfds[0] = pollfd(sim.s[b.BOARD], POLLIN)
        lines.pollfds[1] = pollfd(sim.s[b.HOST], POLLIN)
        interrupted = wait_readable(lines.pollfds, 2 if is_open else 1, lines.timespec, wait) < 0
        if not is_open and not interrupted:
            wait_readable(lines.pollfds, 2, lines.timespec, 0)
        now = monotonic_ns(lines.timespec)
        if interrupted:
            continue
        reason = _do_due(sim, lines, now)
        if reason != STOPPED:
            return reason
        board, host = returned_events(lines.pollfds[0]), returned_events(lines.pollfds[1])
        if board != 0 and sim.s[b.BOARD] >= 0:
            size = _read(sim.s[b.BOARD], lines.buffer.ctypes.data, b.BUFFER_BYTES)
            if size == 0:
                return BOARD_GONE
            _from_board(sim, lines, size, now)
        if sim.s[b.HOST] >= 0:
            sim.s[b.PORT_OPEN] = 0 if host & POLLHUP and host & POLLIN == 0 else 1
        if host & POLLIN:
            size = _read(sim.s[b.HOST], lines.buffer.ctypes.data, b.BUFFER_BYTES)
            _from_host(sim, lines, size, now)
