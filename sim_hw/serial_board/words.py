"""The board's own words in the simulation's state, its status bits, and the buffers of its line."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from sim_hw import layout as w
from sim_hw.layout import BYTES, INTS

ENABLED, WATCHDOG, ENCODER_FAULT, AMPLIFIER_FAULT = 1, 2, 4, 8
BAD_FRAME, REJECTED, EXTERNAL_STOP, UNCONFIGURED = 16, 32, 64, 128
LATCHED = WATCHDOG | ENCODER_FAULT | AMPLIFIER_FAULT | EXTERNAL_STOP
"""Bits that keep the output off until a COMMAND with enable 0."""

_B = w.DEVICE_WORDS
MASTER = _B
"""Descriptor of the line's far end; −1 while the cable is out."""
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
"""What the HELLO reply says."""
POWER_UP_NS = _B + 9
COMMAND_SEQ = _B + 10
RAW_LENGTH = _B + 11
"""Bytes of the frame being received; beyond LONGEST_FRAME they are only counted."""
BYTE_NS = _B + 12
"""Time of one byte on the emulated line; 0: the line is not emulated."""
RECEIVING_UNTIL_NS = _B + 13
SENDING_UNTIL_NS = _B + 14
RESET_UNTIL_NS = _B + 15
"""The processor is in reset until then; FAR_NS when it runs."""
PLUG_IN_NS = _B + 16
"""The cable is put back then; FAR_NS while it is in."""
CAUSE_UNTIL_NS = _B + 17
"""Three words: until when the causes of ENCODER_FAULT, AMPLIFIER_FAULT and EXTERNAL_STOP last."""

FIRMWARE = 0x0102
SERIAL_NUMBER = 0x51AB0001
WATCHDOG_MIN_MS, WATCHDOG_MAX_MS, WATCHDOG_POWER_UP_MS = 2, 10_000, 20

OFF_COMMAND, OFF_HELLO, OFF_WATCHDOG, OFF_FAULT, OFF_REBOOT = range(1, 6)
"""``code`` of a DISABLE row: why."""

SAID_HELLO, CONFIGURED, CLOSED, OPENED, UNPLUGGED, PLUGGED, DROPPED_FRAME = range(1, 8)
"""``detail`` of a STATE row: what happened; its ``code`` is the status byte."""

BUFFER_BYTES = 512


class Line(NamedTuple):
    """Scratch memory of the line.

    Attributes:
        buffer: (BUFFER_BYTES,) uint8, what ``read`` brings. raw: (64,) the frame being received.
        payload, reply, wire: (64,) a received payload, a payload to send, a frame to send.
        pollfds: (1,) int64. timespec: (2,) int64.
    """

    buffer: NDArray[Any]
    raw: NDArray[Any]
    payload: NDArray[Any]
    reply: NDArray[Any]
    wire: NDArray[Any]
    pollfds: NDArray[Any]
    timespec: NDArray[Any]


LINE = numba.types.NamedTuple((BYTES, BYTES, BYTES, BYTES, BYTES, INTS, INTS), Line)
"""Numba's type of a :class:`Line`."""


def new_line() -> Line:
    """Empty buffers."""
    raw, payload, reply, wire = np.zeros((4, w.HELD_BYTES), np.uint8)
    buffer = np.zeros(BUFFER_BYTES, np.uint8)
    return Line(buffer, raw, payload, reply, wire, pollfds=np.zeros(1, np.int64), timespec=np.zeros(2, np.int64))
