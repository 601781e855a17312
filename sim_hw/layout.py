"""The memory of a simulated device's compiled service.

``Sim`` contains its arrays. ``s`` is the state as int64 words and ``sf`` the same memory as float64; the numbers
below are the words of every device; those of one kind of device begin at ``DEVICE_WORDS``. Instants are CLOCK_MONOTONIC, ns.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
from numpy.typing import NDArray

from sim_hw.log import ROW

FAR_NS = 2**62
"""An instant that is never reached."""

STOP = 0
"""Set by Python to end the service."""
LOG_HEAD = 1
"""Rows put into the ring."""
LOG_TAIL = 2
"""Rows taken out of it."""
LOG_DROPPED = 3
"""Rows lost because the ring was full."""
START_NS = 4
"""Instant of switching the device on."""
ENABLED_NS = 5
"""Instant of the first enable of its amplifier; FAR_NS before that."""
HAND_NEXT = 6
"""Index of the next step of the hand."""
COMMAND_A = 7
"""f64: present decoded command, A."""
COUNTS_OFFSET = 8
"""Count at position 0."""
FROZEN_UNTIL_NS = 9
"""End of a frozen counter; 0 if it is not frozen."""
FROZEN_COUNTS = 10
"""Its count while it is frozen."""
GLITCH_COUNTS = 11
"""Added to the next GLITCH_LEFT samples."""
GLITCH_LEFT = 12
"""Number of further wrong samples."""
SILENT_UNTIL_NS = 13
"""End of a time in which the device sends nothing; 0 for none."""
RANDOM = 14
"""State of the random generator for corrupted bits."""
HAND_FROM = 15
"""Origin of the hand's steps: 0: START_NS; 1: ENABLED_NS."""
CURRENT_GAIN = 16
"""f64: motor current over command."""
NO_WATCHDOG = 17
"""1: the watchdog does not work."""
RELEASED_UNTIL_NS = 18
"""End of a release of the enable input; 0 while it is held."""
DEVICE_WORDS = 32
"""First word for one kind of device."""
STATE_WORDS = 96

FAULT_KIND = 0
FAULT_FROM = 1
"""Origin of AT_NS: 0: START_NS; 1: ENABLED_NS."""
FAULT_AT_NS = 2
FAULT_FRAMES = 3
"""Bits of the affected kinds of frames."""
FAULT_COUNT = 4
FAULT_DELAY_NS = 5
FAULT_DURATION_NS = 6
"""FAR_NS: permanent."""
FAULT_SIZE = 7
"""Bytes of garbage, or of an object."""
FAULT_COUNTS = 8
FAULT_CODE = 9
FAULT_STATE = 10
"""UNSIGNALLED, WAITING, ACTIVE (frame faults only) or OVER."""
FAULT_LEFT = 11
"""Number of further affected frames."""
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
"""When the frame is forwarded; 0: the slot is free."""
HELD_ORDER = 1
"""Order of frames with the same instant."""
HELD_FRAME = 2
"""Bit of the frame's kind."""
HELD_LENGTH = 3
HELD_WORDS = 4


class Sim(NamedTuple):
    """Memory of a compiled service.

    Attributes:
        s: (STATE_WORDS,) int64. sf: the same as float64.
        f: (PLANT_SIZE,) the plant's block, see :mod:`hapticd.plant.kernel`. i: the same as int64.
        ring: (RING_ROWS,) log rows, see :mod:`sim_hw.log`.
        hand_ns: instants of the hand's steps, from the origin HAND_FROM. hand_force: N m or N.
        faults: (n, FAULT_WORDS) int64.
        held: (HELD_SLOTS, HELD_WORDS) int64 and held_bytes: (HELD_SLOTS, HELD_BYTES) uint8, delayed frames.
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
