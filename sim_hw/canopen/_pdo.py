"""Compiled process data: sampling by SYNC, packing of TPDOs and unpacking of RPDOs (CiA 301, 7.2.2).

:mod:`sim_hw.canopen._mapping` makes the tables in the block from 0x1400…, 0x1600…, 0x1800…, 0x1A00… whenever a master
writes one of them.
"""

from __future__ import annotations

import numpy as np

from hapticd.jit import njit
from hapticd.plant import kernel
from sim_hw import layout as common
from sim_hw._motion import end_sample, log_row, take_counts
from sim_hw.canopen import _sending
from sim_hw.canopen import layout as w
from sim_hw.canopen._drive import emergency, take_up
from sim_hw.canopen._power import CURRENT_UNIT, rounded, torque_permille
from sim_hw.canopen.layout import BOOL, MACHINE, Machine
from sim_hw.layout import I64
from sim_hw.log import COMMAND, SAMPLE

LAST_SYNCHRONOUS = 240
"""Transmission types up to this one wait for SYNC; 254 and 255 act on the event itself."""
ENABLE_INPUT = 1 << 16
"""Digital inputs: the first input, connected to the enable that a person holds."""
_LENGTH_ERROR = 0x8210
"""EMCY: PDO not processed due to length error."""
_NS_PER_MS = 1_000_000


@njit("int64(int64)", counted=False)
def _int32(value: int) -> int:
    return ((value + (1 << 31)) & 0xFFFFFFFF) - (1 << 31)


@njit((MACHINE, I64), counted=False)
def refresh_inputs(m: Machine, now: int) -> None:
    """Set the measured objects from the plant at an instant: position, velocity (counts/s), current, torque."""
    counts = _int32(take_counts(m.sim, now))
    m.d[w.POSITION] = counts
    m.d[w.POSITION_INTERNAL] = counts
    sign = -1.0 if m.sim.i[kernel.INVERT] else 1.0
    m.d[w.VELOCITY] = rounded(sign * m.sim.f[kernel.VELOCITY] / m.sim.f[kernel.RAW_RESOLUTION], 31)
    current = m.sim.f[kernel.CURRENT]
    if now < m.d[w.MEASURED_UNTIL_NS]:
        current = 1e-6 * (float(m.d[w.MEASURED_PPM]) * current + float(m.d[w.MEASURED_UA]))
    m.d[w.ACTUAL_CURRENT] = rounded(current / CURRENT_UNIT, 15)
    m.d[w.TORQUE_ACTUAL] = torque_permille(m, current)
    rated = float(m.d[w.RATED_CURRENT]) * 1e-6
    m.d[w.DIGITAL_INPUTS] = 0 if now < m.sim.s[common.RELEASED_UNTIL_NS] else ENABLE_INPUT
    m.d[w.CURRENT_ACTUAL] = rounded(current / rated, 15) if rated > 0.0 else 0


@njit(I64(MACHINE, I64), counted=False)
def _pack(m: Machine, base: int) -> int:
    data = 0
    for entry in range(m.d[base + w.PDO_COUNT]):
        at = base + w.PDO_MAP + 4 * entry
        bits = m.d[at + 2]
        mask = -1 if bits == 64 else (1 << bits) - 1
        data |= (m.d[m.d[at]] & mask) << m.d[at + 1]
    return data


@njit(BOOL(MACHINE, I64, I64), counted=False)
def _unpack(m: Machine, base: int, data: int) -> bool:
    """Write the mapped objects; returns whether the controlword is one of them."""
    controlled = False
    for entry in range(m.d[base + w.PDO_COUNT]):
        at = base + w.PDO_MAP + 4 * entry
        bits = m.d[at + 2]
        value = data >> m.d[at + 1]
        if bits < 64:
            value &= (1 << bits) - 1
            if m.d[at + 3] == 1 and value >> (bits - 1):
                value -= 1 << bits
        m.d[m.d[at]] = value
        controlled |= m.d[at] == w.CONTROLWORD
    return controlled


@njit((MACHINE, I64, I64), counted=False)
def _second_node(m: Machine, base: int, now: int) -> None:
    """A second drive with the same number replies to the same SYNC, with its own position."""
    m.d[w.SECOND_LEFT] -= 1
    position, internal = m.d[w.POSITION], m.d[w.POSITION_INTERNAL]
    m.d[w.POSITION] = _int32(position + m.d[w.SECOND_COUNTS])
    m.d[w.POSITION_INTERNAL] = _int32(internal + m.d[w.SECOND_COUNTS])
    data = _pack(m, base)
    m.d[w.POSITION], m.d[w.POSITION_INTERNAL] = position, internal
    _sending.send(m, _sending.TPDO, m.d[base + w.PDO_COB_ID], m.d[base + w.PDO_BYTES], data, now)


@njit((MACHINE, I64, I64), counted=False)
def transmit(m: Machine, number: int, now: int) -> None:
    """Send TPDO ``number`` (0…3) if it is valid, at the earliest at the end of its inhibit time."""
    base = w.PDO + (4 + number) * w.PDO_WORDS
    if m.d[base + w.PDO_COB_ID] < 0 or m.d[w.NMT] != w.NMT_OPERATIONAL:
        return
    timer = w.TIMER + w.TPDO_TIMER + number
    asynchronous = m.d[base + w.PDO_TYPE] > LAST_SYNCHRONOUS
    if asynchronous and now - m.d[base + w.PDO_SENT_NS] < m.d[base + w.PDO_INHIBIT_NS]:
        m.d[timer] = m.d[base + w.PDO_SENT_NS] + m.d[base + w.PDO_INHIBIT_NS]
        return
    data = _pack(m, base)
    m.d[base + w.PDO_DATA] = m.d[w.STATUSWORD]
    m.d[base + w.PDO_SENT_NS] = now
    m.d[timer] = w.NEVER
    if asynchronous and m.d[base + w.PDO_EVENT_MS]:
        m.d[timer] = now + m.d[base + w.PDO_EVENT_MS] * _NS_PER_MS
    _sending.send(m, _sending.TPDO, m.d[base + w.PDO_COB_ID], m.d[base + w.PDO_BYTES], data, now)
    if number == 0 and m.d[w.SECOND_LEFT] > 0:
        _second_node(m, base, now)


@njit((MACHINE, I64), counted=False)
def transmit_events(m: Machine, now: int) -> None:
    """Send event-driven TPDOs (254, 255): their event is a new statusword."""
    for number in range(4):
        base = w.PDO + (4 + number) * w.PDO_WORDS
        if m.d[base + w.PDO_TYPE] > LAST_SYNCHRONOUS and m.d[base + w.PDO_DATA] != m.d[w.STATUSWORD]:
            refresh_inputs(m, now)
            transmit(m, number, now)


@njit((MACHINE, I64, I64), counted=False)
def _apply(m: Machine, base: int, now: int) -> None:
    controlled = _unpack(m, base, m.d[base + w.PDO_DATA])
    m.d[w.COMMANDS] += 1
    take_up(m, controlled, now)
    log_row(m.sim, now, COMMAND, m.d[w.COMMANDS], m.d[w.CONTROLWORD])


@njit((MACHINE, I64, I64, I64, I64), counted=False)
def receive_rpdo(m: Machine, number: int, length: int, data: int, now: int) -> None:
    """Receive RPDO ``number`` (0…3): apply it now or at SYNC; refuse one that is too short, with an EMCY."""
    base = w.PDO + number * w.PDO_WORDS
    if length < m.d[base + w.PDO_BYTES]:
        m.d[w.ERROR_REGISTER] |= 0x11
        emergency(m, _LENGTH_ERROR, now)
        return
    m.d[base + w.PDO_DATA] = data
    if m.d[base + w.PDO_EVENT_MS]:
        m.d[w.TIMER + w.RPDO_TIMER + number] = now + m.d[base + w.PDO_EVENT_MS] * _NS_PER_MS
    if m.d[base + w.PDO_TYPE] > LAST_SYNCHRONOUS:
        _apply(m, base, now)
    else:
        m.d[base + w.PDO_PENDING] = 1


@njit((MACHINE, I64), counted=False)
def synchronise(m: Machine, now: int) -> None:
    """Process SYNC: sample, send the synchronous TPDOs that are due, apply the waiting RPDOs."""
    refresh_inputs(m, now)
    end_sample(m.sim)
    m.d[w.SAMPLES] += 1
    log_row(m.sim, now, SAMPLE, m.d[w.SAMPLES], m.d[w.STATUSWORD])
    for number in range(4):
        base = w.PDO + (4 + number) * w.PDO_WORDS
        kind = m.d[base + w.PDO_TYPE]
        if kind == 0 and m.d[base + w.PDO_DATA] != m.d[w.STATUSWORD]:
            transmit(m, number, now)
        elif 1 <= kind <= LAST_SYNCHRONOUS:
            m.d[base + w.PDO_SYNCS] += 1
            if m.d[base + w.PDO_SYNCS] >= kind:
                m.d[base + w.PDO_SYNCS] = 0
                transmit(m, number, now)
    for number in range(4):
        base = w.PDO + number * w.PDO_WORDS
        if m.d[base + w.PDO_PENDING] == 1:
            m.d[base + w.PDO_PENDING] = 0
            _apply(m, base, now)


@njit((MACHINE,), counted=False)
def forget(m: Machine) -> None:
    """Reset counted SYNCs, waiting RPDOs and deadlines: a node that leaves Operational loses them."""
    for number in range(4):
        m.d[w.TIMER + w.RPDO_TIMER + number] = w.NEVER
    for number in range(8):
        m.d[w.PDO + number * w.PDO_WORDS + w.PDO_PENDING] = 0
        m.d[w.PDO + number * w.PDO_WORDS + w.PDO_SYNCS] = 0
        m.d[w.PDO + number * w.PDO_WORDS + w.PDO_DATA] = np.int64(-1)
