"""From the board to the host, compiled: frames, with injected faults and the emulated line."""

from __future__ import annotations

from numba import types

from hapticd.jit import njit
from sim_hw import kinds
from sim_hw import layout as w
from sim_hw._clock import write
from sim_hw._faults import pass_frame, random_bits
from sim_hw._held import release
from sim_hw.layout import I64, SIM, Sim
from sim_hw.serial_board import layout as b
from sim_hw.serial_board.framing import encode
from sim_hw.serial_board.layout import LINE, Line


@njit((SIM, LINE, I64, I64), counted=False)
def put_on_line(sim: Sim, line: Line, length: int, ns: int) -> None:
    """Write ``line.wire`` to the port, and release replies that waited for one to pass.

    Without a host the bytes are lost, as on a cable; so are those that a host does not read before the port's
    buffer is full.
    """
    if sim.s[b.LINE_OPEN] == 1:
        write(sim.s[b.MASTER], line.wire.ctypes.data, length)
    release(sim, kinds.REPLY, ns)


@njit(types.boolean(SIM, LINE, I64, I64), counted=False)
def send(sim: Sim, line: Line, length: int, ns: int) -> bool:
    """Send the first ``length`` bytes of ``line.reply`` as a frame at an instant; whether it was sent without a fault."""
    size = encode(line.reply, length, line.wire)
    if sim.s[w.SILENT_UNTIL_NS] > ns:
        return False
    due = ns
    if sim.s[b.BYTE_NS] > 0:
        due = max(ns, sim.s[b.SENDING_UNTIL_NS]) + size * sim.s[b.BYTE_NS]
        sim.s[b.SENDING_UNTIL_NS] = due
    copies, fate = pass_frame(sim, kinds.REPLY, line.wire, size, due, ns)
    for _ in range(copies):
        put_on_line(sim, line, size, ns)
    return fate & (kinds.DROPPED | kinds.CORRUPTED | kinds.REORDERED) == 0


@njit((SIM, LINE, I64), counted=False)
def send_garbage(sim: Sim, line: Line, size: int) -> None:
    """Send random bytes, including zeros."""
    while size > 0:
        chunk = min(size, b.BUFFER_BYTES)
        for n in range(chunk):
            line.buffer[n] = random_bits(sim) & 0xFF
        if sim.s[b.LINE_OPEN] == 1:
            write(sim.s[b.MASTER], line.buffer.ctypes.data, chunk)
        size -= chunk
