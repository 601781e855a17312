"""The words of a serial board in the simulation's state, its status bits, and the buffers of its line.

For both boards: the simulated one, and the test bench of the reference firmware (:mod:`sim_hw.firmware`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from hapticd.jit import njit
from sim_hw import kinds, log
from sim_hw import layout as w
from sim_hw._faults import next_event_ns
from sim_hw._motion import log_row
from sim_hw._plant import build_sim
from sim_hw.layout import BYTES, I64, INTS, SIM, Sim

if TYPE_CHECKING:
    from hapticd.config import Config
    from sim_hw.script import Script

ENABLED, WATCHDOG, ENCODER_FAULT, AMPLIFIER_FAULT = 1, 2, 4, 8
BAD_FRAME, REJECTED, EXTERNAL_STOP, UNCONFIGURED = 16, 32, 64, 128
LATCHED = WATCHDOG | ENCODER_FAULT | AMPLIFIER_FAULT | EXTERNAL_STOP
"""Bits that keep the output off until a COMMAND with enable 0."""

_B = w.DEVICE_WORDS
MASTER = _B
"""Descriptor of the board's end of the port; −1 while it is unplugged."""
LINE_OPEN = _B + 1
"""1 while a host has the port open."""
STATUS = _B + 2
WATCHDOG_NS = _B + 3
WATCHDOG_DUE_NS = _B + 4
"""When the watchdog trips; FAR_NS while the output is disabled."""
DAC_BITS = _B + 5
FULL_SCALE_UA = _B + 6
COUNTER_BITS = _B + 7
VERSION = _B + 8
"""Version in the HELLO reply; −1 on the test bench: that of the firmware."""
POWER_UP_NS = _B + 9
COMMAND_SEQ = _B + 10
RAW_LENGTH = _B + 11
"""Received bytes of a frame from the host; beyond LONGEST_FRAME they are only counted."""
BYTE_NS = _B + 12
"""Time of one byte on the emulated line; 0: the line is not emulated."""
RECEIVING_UNTIL_NS = _B + 13
SENDING_UNTIL_NS = _B + 14
RESET_UNTIL_NS = _B + 15
"""End of a reset or of a time without power; FAR_NS while the processor runs."""
PLUG_IN_NS = _B + 16
"""Instant of plugging in again; FAR_NS while it is plugged in."""
CAUSE_UNTIL_NS = _B + 17
"""Three words: ends of the causes of ENCODER_FAULT, AMPLIFIER_FAULT and EXTERNAL_STOP."""
RELEASED = _B + 20
"""1: the enable input has been open since the last COMMAND with enable 0."""
WHILE_HELD = _B + 21
"""1: the output is on only while RELEASED is 0."""
BENCH_WORDS = _B + 22
"""First word of the test bench."""

FIRMWARE = 0x0102
SERIAL_NUMBER = 0x51AB0001
WATCHDOG_MIN_MS, WATCHDOG_MAX_MS, WATCHDOG_POWER_UP_MS = 2, 10_000, 20

OFF_COMMAND, OFF_HELLO, OFF_WATCHDOG, OFF_FAULT, OFF_REBOOT, OFF_RELEASED = range(1, 7)
"""``code`` of a DISABLE row: the reason."""

SAID_HELLO, CONFIGURED, CLOSED, OPENED, UNPLUGGED, PLUGGED, DROPPED_FRAME = range(1, 8)
"""``detail`` of a STATE row: the event; its ``code`` is the status byte."""

BUFFER_BYTES = 512


class Line(NamedTuple):
    """Scratch memory of the line.

    Attributes:
        page: (PAGE_WORDS,) uint32, shared with an emulated board (:mod:`sim_hw.firmware._page`); else empty.
        buffer: (BUFFER_BYTES,) uint8, for ``read``. raw: (64,) the frame being received from the host.
        payload, wire: (64,) a received payload, a frame to send.
        reply: (64,) a payload to send, or the frame being received from an emulated board.
        pollfds: (2,) int64. timespec: (2,) int64.
    """

    page: NDArray[Any]
    buffer: NDArray[Any]
    raw: NDArray[Any]
    payload: NDArray[Any]
    reply: NDArray[Any]
    wire: NDArray[Any]
    pollfds: NDArray[Any]
    timespec: NDArray[Any]


_PAGE = numba.types.Array(numba.uint32, 1, "C")
LINE = numba.types.NamedTuple((_PAGE, BYTES, BYTES, BYTES, BYTES, BYTES, INTS, INTS), Line)
"""Numba's type of a :class:`Line`."""


def new_line(page: NDArray[np.uint32]) -> Line:
    """Empty buffers, and a page."""
    raw, payload, reply, wire = np.zeros((4, w.HELD_BYTES), np.uint8)
    pollfds, timespec = np.zeros((2, 2), np.int64)
    return Line(page, np.zeros(BUFFER_BYTES, np.uint8), raw, payload, reply, wire, pollfds, timespec)


def new_board(config: Config, script: Script, dac_bits: int, full_scale_A: float) -> Sim:
    """A board's memory: the processor runs, the cable is not plugged in, the log has begun.

    Args:
        config: the plant file. script: hand, start and faults. dac_bits, full_scale_A: of the board's converter.
    """
    sim = build_sim(config, script)
    sim.s[MASTER] = -1
    sim.s[WATCHDOG_DUE_NS] = sim.s[RESET_UNTIL_NS] = sim.s[PLUG_IN_NS] = w.FAR_NS
    sim.s[DAC_BITS], sim.s[FULL_SCALE_UA] = dac_bits, round(full_scale_A * 1e6)
    start_ns = int(sim.s[w.START_NS])
    log_row(sim, start_ns, log.START, 0, 0)
    if script.wrong_version is not None:
        log_row(sim, start_ns, log.FAULT_INJECTED, kinds.WRONG_VERSION, -1)
    return sim


@njit(I64(SIM), counted=False)
def next_due_ns(sim: Sim) -> int:
    """Instant of the next event that does not depend on host or firmware: FAR_NS for none."""
    return min(sim.s[WATCHDOG_DUE_NS], sim.s[RESET_UNTIL_NS], sim.s[PLUG_IN_NS], next_event_ns(sim))


@njit(I64(I64), inline=True, counted=False)
def fault_bit(which: int) -> int:
    """Status bit of the cause in the word CAUSE_UNTIL_NS + ``which``."""
    return EXTERNAL_STOP if which == 2 else ENCODER_FAULT << which
