"""The bench's own words in the simulation's state, and the buffers of its two lines."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from sim_hw import layout as w
from sim_hw.layout import BYTES, INTS

ENCODER_FAULT, AMPLIFIER_FAULT, EXTERNAL_STOP = 4, 8, 64
"""Bits of the causes, those of the status byte."""

_B = w.DEVICE_WORDS
HOST = _B
"""Descriptor of the port's far end; −1 while the cable is out."""
BOARD = _B + 1
"""Descriptor of the line to the board; −1 while it is off."""
PORT_OPEN = _B + 2
"""1 while a host has the port open."""
FRAMED = _B + 3
"""1: bytes go on to the board frame by frame, because a fault may hit one; 0: as they come."""
VERSION = _B + 4
"""What the HELLO reply is made to say; −1: what the board says."""
HOST_LENGTH = _B + 5
"""Bytes of the frame coming from the host; beyond LONGEST_FRAME they are only counted."""
BOARD_LENGTH = _B + 6
"""The same from the board."""
READ = _B + 7
"""Outputs of the board that were taken."""
ENABLED = _B + 8
"""1 while the board's enable line is on."""
DAC_BITS = _B + 9
FULL_SCALE_UA = _B + 10
OFF_UNTIL_NS = _B + 11
"""The board is off until then; FAR_NS when it runs."""
PLUG_IN_NS = _B + 12
"""The cable is put back then; FAR_NS while it is in."""
GLITCH_SHOWN = _B + 13
"""1 when a SAMPLE came while an injected glitch was to be seen."""
CAUSE_UNTIL_NS = _B + 14
"""Three words: until when the causes of ENCODER_FAULT, AMPLIFIER_FAULT and EXTERNAL_STOP last."""

BUFFER_BYTES = 512
WORDS = numba.types.Array(numba.uint32, 1, "C")


class Lines(NamedTuple):
    """Scratch memory of the lines, and the page.

    Attributes:
        page: (PAGE_WORDS,) uint32, shared with the board.
        buffer: (BUFFER_BYTES,) uint8, what ``read`` brings.
        from_host, from_board: (64,) frames being received. payload, wire: (64,).
        pollfds: (2,) int64. timespec: (2,) int64.
    """

    page: NDArray[Any]
    buffer: NDArray[Any]
    from_host: NDArray[Any]
    from_board: NDArray[Any]
    payload: NDArray[Any]
    wire: NDArray[Any]
    pollfds: NDArray[Any]
    timespec: NDArray[Any]


LINES = numba.types.NamedTuple((WORDS, BYTES, BYTES, BYTES, BYTES, BYTES, INTS, INTS), Lines)
"""Numba's type of :class:`Lines`."""


def new_lines(page: NDArray[Any]) -> Lines:
    """Empty buffers."""
    from_host, from_board, payload, wire = np.zeros((4, w.HELD_BYTES), np.uint8)
    buffer = np.zeros(BUFFER_BYTES, np.uint8)
    # The memory of the map as a plain array, which compiled code takes.
    memory = np.frombuffer(page, np.uint32)
    return Lines(
        memory, buffer, from_host, from_board, payload, wire, np.zeros(2, np.int64), timespec=np.zeros(2, np.int64)
    )
