"""Frames from the bus, and the drive's service for each."""

from __future__ import annotations

from hapticd.jit import njit
from sim_hw import layout as common
from sim_hw._held import next_held, take
from sim_hw.canopen import _node, _pdo, _sending
from sim_hw.canopen import layout as w
from sim_hw.canopen._drive import emergency
from sim_hw.canopen._sending import ERROR, EXTENDED, OTHER, REMOTE, RPDO, SDO_REPLY, SDO_REQUEST, SYNC, TPDO
from sim_hw.canopen._timeline import advance
from sim_hw.canopen.layout import MACHINE, Machine
from sim_hw.layout import I64

_SDO_CLIENT = 0x600
_GUARD = 0x700
_SYNC_LENGTH_ERROR = 0x8240
"""EMCY: unexpected SYNC data length."""
_REFUSED = 0x11


@njit(I64(MACHINE, I64), counted=False)
def _rpdo(m: Machine, cob_id: int) -> int:
    """Number (0…3) of the RPDO with a COB-ID, −1 for none."""
    for number in range(4):
        if m.d[w.PDO + number * w.PDO_WORDS + w.PDO_COB_ID] == cob_id:
            return number
    return -1


@njit(I64(MACHINE, I64), counted=False)
def _kind(m: Machine, low: int) -> int:
    """The kind of a frame in a script."""
    cob_id = _sending.identifier(low)
    kind = OTHER
    if low & (REMOTE | EXTENDED | ERROR):
        kind = OTHER
    elif cob_id == m.d[w.SYNC_COB_ID] & 0x7FF:
        kind = SYNC
    elif cob_id == _SDO_CLIENT + m.d[w.NODE_ID]:
        kind = SDO_REQUEST
    elif _rpdo(m, cob_id) >= 0:
        kind = RPDO
    return kind


@njit((MACHINE, I64, I64, I64, I64), counted=False)
def _accept(m: Machine, kind: int, low: int, data: int, now: int) -> None:
    cob_id, length = _sending.identifier(low), _sending.length_of(low)
    state = m.d[w.NMT]
    if low & (EXTENDED | ERROR):
        return
    if low & REMOTE:
        if cob_id == _GUARD + m.d[w.NODE_ID]:
            _node.answer_guard(m, now)
    elif cob_id == 0:
        if length == 2:
            _node.command(m, data, now)
    elif kind == SYNC:
        if length:
            m.d[w.ERROR_REGISTER] |= _REFUSED
            emergency(m, _SYNC_LENGTH_ERROR, now)
        elif state == w.NMT_OPERATIONAL:
            _pdo.synchronise(m, now)
    elif kind == SDO_REQUEST:
        if state in (w.NMT_OPERATIONAL, w.NMT_PRE_OPERATIONAL) and m.d[w.SDO_COUNT] < w.QUEUE:
            m.sdo[m.d[w.SDO_COUNT], 0] = low
            m.sdo[m.d[w.SDO_COUNT], 1] = data
            m.d[w.SDO_COUNT] += 1
    elif kind == RPDO and state == w.NMT_OPERATIONAL:
        _pdo.receive_rpdo(m, _rpdo(m, cob_id), length, data, now)
    _pdo.transmit_events(m, now)


@njit((MACHINE, I64, I64, I64), counted=False)
def receive(m: Machine, low: int, data: int, now: int) -> None:
    """Process one frame received at an instant; its replies are then in ``m.out``.

    A frame found when this process wakes up after a time-out counts as received in time, because a real drive
    would have been awake.
    """
    now = min(now, m.d[w.TIMER + w.GUARD_TIMER] - 1)
    for number in range(4):
        now = min(now, m.d[w.TIMER + w.RPDO_TIMER + number] - 1)
    advance(m, now)
    if _sending.connected(m, now):
        kind = _kind(m, low)
        if _sending.passes(m, kind, low, data, now):
            _accept(m, kind, m.frame[0], m.frame[1], now)


@njit((MACHINE, I64), counted=False)
def let_go(m: Machine, now: int) -> None:
    """Advance the drive to an instant, and forward every frame that a fault has held until then."""
    advance(m, now)
    if m.d[w.SYNC_SENT] == 1:
        m.d[w.SYNC_SENT] = 0
        if m.d[w.NMT] == w.NMT_OPERATIONAL:
            _pdo.synchronise(m, now)
    slot, due = next_held(m.sim)
    while due <= now:
        kind = m.sim.held[slot, common.HELD_FRAME]
        take(m.sim, slot, m.octets)
        low, data = m.frame[0], m.frame[1]
        if kind in (TPDO, SDO_REPLY):
            _sending.put(m, low, data)
        elif _sending.connected(m, now):
            _accept(m, kind, low, data, now)
        slot, due = next_held(m.sim)
