"""Memory layout of one simulated drive, shared by the compiled loop and by Python.

The drive is one thread: the compiled loop returns before Python accesses the memory, so no word needs a lock. The first
words are the object dictionary itself: SDO transfers and PDOs read and write the same word.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from sim_hw.layout import BYTES, FAR_NS, FLOATS, I64, INTS, SIM, START_NS, Sim

F64, BOOL = numba.float64, numba.boolean

NEVER = FAR_NS
"""An instant (ns) that is never reached."""

# Objects that compiled code uses, and their slots in the block.
_COMMUNICATION = (0x1001, 0x1002, 0x1005, 0x100C, 0x100D, 0x1014, 0x1017, 0x1029)
ERROR_REGISTER, EVENT_STATUS, SYNC_COB_ID, GUARD_TIME, LIFE_TIME_FACTOR = range(5)
EMCY_COB_ID, HEARTBEAT_TIME, ERROR_BEHAVIOUR = range(5, 8)
_COPLEY = (0x2110, 0x2111, 0x2112, 0x2113, 0x2183, 0x221C, 0x2300, 0x2340)
PEAK_LIMIT, CONTINUOUS_LIMIT, PEAK_TIME, CURRENT_RAMP = range(8, 12)
LATCHED_FAULTS, ACTUAL_CURRENT, DESIRED_STATE, PROGRAMMED_CURRENT = range(12, 16)
_STATES = (0x6007, 0x603F, 0x6040, 0x6041, 0x605A, 0x605E, 0x6060, 0x6061, 0x6502)
ABORT_OPTION, ERROR_CODE, CONTROLWORD, STATUSWORD = range(16, 20)
QUICK_STOP_OPTION, FAULT_OPTION, MODE, MODE_DISPLAY, SUPPORTED_MODES = range(20, 25)
_MOTION = (0x6063, 0x6064, 0x606C, 0x6071, 0x6072, 0x6074, 0x6075, 0x6076, 0x6077, 0x6078, 0x6087)
POSITION_INTERNAL, POSITION, VELOCITY, TARGET_TORQUE, MAX_TORQUE, TORQUE_DEMAND = range(25, 31)
RATED_CURRENT, RATED_TORQUE, TORQUE_ACTUAL, CURRENT_ACTUAL, TORQUE_SLOPE = range(31, 36)
ERROR_COUNT = 36
"""First entry of 0x1003."""
KNOWN_OBJECTS = (
    *((index, int(index == 0x1029)) for index in (*_COMMUNICATION, *_COPLEY, *_STATES, *_MOTION)),
    *((0x1003, sub) for sub in range(9)),
    (0x60FD, 0),
    (0x1006, 0),
)
"""Index and sub-index of slot 0, 1, 2, … of the block."""
DIGITAL_INPUTS, SYNC_PERIOD = ERROR_COUNT + 9, ERROR_COUNT + 10
ERROR_FIELDS = 8
"""Entries of 0x1003 that follow ERROR_COUNT."""
OBJECT_WORDS = 256
"""Room for every numeric object; those not named above come after them in the order of the EDS."""

# The drive's own state.
_OWN = OBJECT_WORDS
STATE, PREVIOUS_CONTROL, NMT, NODE_ID, POWERED, RESET, GUARD_TOGGLE, BUS_OFF_UNTIL_NS = range(_OWN, _OWN + 8)
UNPLUGGED_UNTIL_NS, SAMPLES, COMMANDS, SDO_COUNT, OUT_COUNT, LOST_FRAMES, FOLDED, HEAT_NS = range(_OWN + 8, _OWN + 16)
# f64 words.
TARGET, DEMAND, HEAT = range(_OWN + 16, _OWN + 19)
"""A: the master's target after limits; the same after the slope. Then I²t, A² s above the continuous current."""

MEASURED_UNTIL_NS, MEASURED_PPM, MEASURED_UA, SECOND_LEFT, SECOND_COUNTS, SYNC_SENT = range(_OWN + 19, _OWN + 25)
"""Injected faults: end of a wrong measured current, the true one times MEASURED_PPM plus MEASURED_UA; remaining TPDO 1 of a
second node, whose position is larger by SECOND_COUNTS. SYNC_SENT: the drive's own SYNC waits to be processed."""

TIMER = _OWN + 25
"""Instants (ns) of the drive's own actions; NEVER for none."""
RAMP_TIMER, HEAT_TIMER, GUARD_TIMER, HEARTBEAT_TIMER = range(4)
QUICK_STOP_TIMER, REACTION_TIMER, WAKE_TIMER, TPDO_TIMER = range(4, 8)
RPDO_TIMER = TPDO_TIMER + 4
"""Deadlines of RPDO 1…4, after four timers of TPDOs."""
SYNC_TIMER = RPDO_TIMER + 4
"""The next SYNC that the drive produces."""
TIMERS = SYNC_TIMER + 1
LAZY_TIMERS = 2
"""The first timers need no wake-up: their effect is visible only in the next frame."""

PDO = TIMER + TIMERS
"""Eight PDOs, RPDO 1…4 then TPDO 1…4."""
PDO_COB_ID, PDO_TYPE, PDO_COUNT, PDO_BYTES, PDO_SYNCS = range(5)
PDO_PENDING, PDO_DATA, PDO_EVENT_MS, PDO_INHIBIT_NS, PDO_SENT_NS = range(5, 10)
"""COB-ID (−1: not valid), transmission type, entries, bytes; counted SYNCs; whether it waits for SYNC, and its data."""
PDO_MAP = 10
"""Up to eight entries of (slot, first bit, bits, signed)."""
PDO_WORDS = PDO_MAP + 8 * 4
BLOCK_WORDS = PDO + 8 * PDO_WORDS

QUEUE = 256
"""Capacity of the queues of outgoing frames and of SDO requests for Python."""

# Resets done by Python, which has the object dictionary.
NO_RESET, RESET_NODE, RESET_COMMUNICATION = range(3)

# NMT states as in a guarding reply (CiA 301, 7.2.8.3).
NMT_BOOTING, NMT_STOPPED, NMT_OPERATIONAL, NMT_PRE_OPERATIONAL = 0, 4, 5, 127


class Machine(NamedTuple):
    """Memory of one drive for compiled code.

    Attributes:
        sim: plant, script and log, see :mod:`sim_hw.layout`.
        d: (BLOCK_WORDS,) int64, objects and state. a: the same memory as float64.
        out: (QUEUE, 2) outgoing frames. sdo: (QUEUE, 2) SDO requests for Python; two words are one frame.
        frame: (2,) scratch for one frame. octets: (16,) uint8, the same memory.
    """

    sim: Sim
    d: NDArray[Any]
    a: NDArray[Any]
    out: NDArray[Any]
    sdo: NDArray[Any]
    frame: NDArray[Any]
    octets: NDArray[Any]


_FRAMES = numba.types.Array(I64, 2, "C")
MACHINE = numba.types.NamedTuple((SIM, INTS, FLOATS, _FRAMES, _FRAMES, INTS, BYTES), Machine)
"""Numba's type of a :class:`Machine`, for signatures."""


def new_machine(sim: Sim, node_id: int) -> Machine:
    """Memory of a drive without power: every timer off, no frames."""
    d = np.zeros(BLOCK_WORDS, np.int64)
    d[NODE_ID] = node_id
    d[TIMER : TIMER + TIMERS] = NEVER
    d[HEAT_NS] = sim.s[START_NS]
    frame = np.zeros(2, np.int64)
    out, sdo = np.zeros((QUEUE, 2), np.int64), np.zeros((QUEUE, 2), np.int64)
    return Machine(sim, d, d.view(np.float64), out, sdo, frame, frame.view(np.uint8))
