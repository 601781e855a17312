"""The memory that a simulated device's compiled service works on.

``Sim`` bundles its arrays. ``s`` holds the state as int64 words and ``sf`` is the same memory read as float64; the numbers
below are the words every device has, a device's own begin at ``DEVICE_WORDS``. Instants are CLOCK_MONOTONIC, ns.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
from numpy.typing import NDArray

from sim_hw.log import ROW

FAR_NS = 2**62
"""An instant that never comes."""

STOP = 0
"""Set by Python: the service returns."""
LOG_HEAD = 1
"""Rows put into the ring."""
LOG_TAIL = 2
"""Rows taken out of it."""
LOG_DROPPED = 3
"""Rows that found the ring full."""
START_NS = 4
"""When the device was switched on."""
ENABLED_NS = 5
"""When its amplifier was first enabled; FAR_NS before that."""
HAND_NEXT = 6
"""Index of the next step of the hand."""
COMMAND_A = 7
"""f64: decoded command in force, A."""
COUNTS_OFFSET = 8
"""What the counter shows at position 0."""
FROZEN_UNTIL_NS = 9
"""The counter stands still until then; 0 when it does not."""
FROZEN_COUNTS = 10
"""What it shows meanwhile."""
GLITCH_COUNTS = 11
"""Added to a sample while GLITCH_LEFT lasts."""
GLITCH_LEFT = 12
"""Samples still to be wrong."""
SILENT_UNTIL_NS = 13
"""The device sends nothing until then; 0 when it does."""
RANDOM = 14
"""State of the generator that chooses which bit of a frame is corrupted."""
HAND_FROM = 15
"""0: the hand's steps count from START_NS; 1: from ENABLED_NS."""
CURRENT_GAIN = 16
"""f64: current in the motor over the one commanded."""
NO_WATCHDOG = 17
"""1: nobody's silence ends a current."""
RELEASED_UNTIL_NS = 18
"""The person lets go of the enable input until then; 0 while it is held."""
DEVICE_WORDS = 32
"""First word of the device's own."""
STATE_WORDS = 96

FAULT_KIND = 0
FAULT_FROM = 1
"""0: AT_NS counts from START_NS; 1: from ENABLED_NS."""
FAULT_AT_NS = 2
FAULT_FRAMES = 3
"""Bits of the frames that are meant."""
FAULT_COUNT = 4
FAULT_DELAY_NS = 5
FAULT_DURATION_NS = 6
"""FAR_NS: for good."""
FAULT_SIZE = 7
"""Bytes of garbage, or of an object."""
FAULT_COUNTS = 8
FAULT_CODE = 9
FAULT_STATE = 10
"""UNSIGNALLED, WAITING, ACTIVE (frame faults only) or OVER."""
FAULT_LEFT = 11
"""Frames still to be hit."""
FAULT_OBJECT = 12
"""Index of an object, and its sub-index times 2^16."""
FAULT_VALUE = 13
FAULT_FACTOR_PPM = 14
FAULT_CURRENT_UA = 15
FAULT_WORDS = 16

WAITING, ACTIVE, OVER, UNSIGNALLED = 0, 1, 2, 3

RING_ROWS = 1 << 16
HELD_SLOTS = 64
HELD_BYTES = 64

HELD_DUE_NS = 0
"""When the frame goes on; 0: the slot is free."""
HELD_ORDER = 1
"""Frames due at one instant go in this order."""
HELD_FRAME = 2
"""Bit of the frame's kind."""
HELD_LENGTH = 3
HELD_WORDS = 4


class Sim(NamedTuple):
    """Everything a compiled service works on.

    Attributes:
        s: (STATE_WORDS,) int64. sf: the same as float64.
        f: (PLANT_SIZE,) the plant's block, see :mod:`hapticd.plant.kernel`. i: the same as int64.
        ring: (RING_ROWS,) log rows, see :mod:`sim_hw.log`.
        hand_ns: instants of the hand's steps, counted from what HAND_FROM says. hand_force: N m or N.
        faults: (n, FAULT_WORDS) int64.
        held: (HELD_SLOTS, HELD_WORDS) int64 and held_bytes: (HELD_SLOTS, HELD_BYTES) uint8, frames on their way.
    """

    s: NDArray[Any]
    sf: NDArray[Any]
    f: NDArray[Any]
    i: NDArray[Any]
    ring: NDArray[Any]
    hand_ns: NDArray[Any]
    hand_force: NDArray[Any]
    faults: NDArray[Any]
    held: NDArray[Any]
    held_bytes: NDArray[Any]


I64 = numba.int64
INTS = numba.types.Array(I64, 1, "C")
FLOATS = numba.types.Array(numba.float64, 1, "C")
BYTES = numba.types.Array(numba.uint8, 1, "C")
_INTS_2D = numba.types.Array(I64, 2, "C")
_BYTES_2D = numba.types.Array(numba.uint8, 2, "C")
_ROWS = numba.types.Array(numba.from_dtype(ROW), 1, "C")

SIM = numba.types.NamedTuple((INTS, FLOATS, FLOATS, INTS, _ROWS, INTS, FLOATS, _INTS_2D, _INTS_2D, _BYTES_2D), Sim)
"""Numba's type of a :class:`Sim`, for signatures."""
