"""Frames to and from the drive, and the effect of scripted faults on them.

A frame is two words, with the memory layout of ``struct can_frame``: identifier and flags (32 bits), length (8 bits),
padding; then eight data bytes, the first the least significant.
"""

from __future__ import annotations

from hapticd.jit import njit
from sim_hw import kinds
from sim_hw import layout as common
from sim_hw._faults import frame_fate, random_bits
from sim_hw._held import hold, release
from sim_hw.canopen import layout as w
from sim_hw.canopen.layout import BOOL, MACHINE, Machine
from sim_hw.layout import I64

REMOTE = 0x40000000
ERROR = 0x20000000
EXTENDED = 0x80000000
BUS_OFF = 0x40
"""CAN_ERR_BUSOFF, in the identifier of an error frame."""
FRAME_BYTES = 16
"""Bytes of a ``struct can_frame``."""
_FLAGS_AND_ID = 0xFFFFFFFF
_ID = 0x1FFFFFFF

OTHER = 0
"""Frames that a script cannot name: NMT, EMCY, guarding."""
SDO_REQUEST, SDO_REPLY, SYNC, TPDO, RPDO = kinds.REQUEST, kinds.REPLY, kinds.SYNC, kinds.TPDO, kinds.RPDO


@njit("int64(int64, int64)", counted=False)
def header(cob_id: int, length: int) -> int:
    """First word of a frame."""
    return cob_id | length << 32


@njit("int64(int64)", counted=False)
def identifier(low: int) -> int:
    """Identifier without flags."""
    return low & _ID


@njit("int64(int64)", counted=False)
def length_of(low: int) -> int:
    """Data bytes of a frame, at most 8."""
    return min((low >> 32) & 0xFF, 8)


@njit((MACHINE, I64, I64), counted=False)
def put(m: Machine, low: int, data: int) -> None:
    """Queue a frame for the bus; if the queue is full, it is lost and counted."""
    if m.d[w.OUT_COUNT] == w.QUEUE:
        m.d[w.LOST_FRAMES] += 1
        return
    m.out[m.d[w.OUT_COUNT], 0] = low
    m.out[m.d[w.OUT_COUNT], 1] = data
    m.d[w.OUT_COUNT] += 1


@njit((MACHINE, I64), counted=False)
def _corrupt(m: Machine, length: int) -> None:
    """Invert one data bit and remove a byte (add one if there was none), as a faulty gateway may do.

    A CAN controller would detect such an error and repeat the frame.
    """
    if length:
        m.frame[1] ^= 1 << (random_bits(m.sim) % (8 * length))
    m.frame[0] = header(m.frame[0] & _FLAGS_AND_ID, length - 1 if length else 1)


@njit(BOOL(MACHINE, I64, I64, I64, I64), counted=False)
def passes(m: Machine, kind: int, low: int, data: int, now: int) -> bool:
    """Apply the present faults to a frame; whether it passes at once, and is then in ``m.frame``.

    Delayed frames and those that wait for the next of their kind are held; of a duplicate the second
    is held, due at once.
    """
    m.frame[0], m.frame[1] = low, data
    fate, delay = frame_fate(m.sim, kind, now)
    if fate & kinds.DROPPED:
        return False
    if fate & kinds.CORRUPTED:
        _corrupt(m, length_of(low))
    at_once = fate & (kinds.DELAYED | kinds.REORDERED) == 0
    due = common.FAR_NS if fate & kinds.REORDERED else now + delay
    if not at_once:
        hold(m.sim, due, kind, m.octets, FRAME_BYTES)
    else:
        release(m.sim, kind, now)
    if fate & kinds.DUPLICATED:
        hold(m.sim, due, kind, m.octets, FRAME_BYTES)
    return at_once


@njit(BOOL(MACHINE, I64), counted=False)
def connected(m: Machine, now: int) -> bool:
    """Whether frames reach the drive."""
    return m.d[w.POWERED] == 1 and now >= m.d[w.BUS_OFF_UNTIL_NS] and now >= m.d[w.UNPLUGGED_UNTIL_NS]


@njit((MACHINE, I64, I64, I64, I64, I64), counted=False)
def send(m: Machine, kind: int, cob_id: int, length: int, data: int, now: int) -> None:
    """Send a frame of the drive, unless it has no power or no bus, or a fault silences it."""
    if (
        connected(m, now)
        and now >= m.sim.s[common.SILENT_UNTIL_NS]
        and passes(m, kind, header(cob_id, length), data, now)
    ):
        put(m, m.frame[0], m.frame[1])
