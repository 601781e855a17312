"""PDO configuration (CiA 301, 7.5.2.33…38): allowed writes of a master, and the tables for compiled code."""

from __future__ import annotations

from typing import TYPE_CHECKING

from canopen.objectdictionary.datatypes import SIGNED_TYPES

from sim_hw.canopen import dictionary as codes
from sim_hw.canopen import layout as w
from sim_hw.canopen.dictionary import AbortError, ObjectDictionary

if TYPE_CHECKING:
    import numpy as np
    from canopen.objectdictionary import ODVariable
    from numpy.typing import NDArray

RPDO_COMMUNICATION, RPDO_MAPPING, TPDO_COMMUNICATION, TPDO_MAPPING = 0x1400, 0x1600, 0x1800, 0x1A00
NOT_VALID = 1 << 31
_EXTENDED = 1 << 29
_BITS_IN_A_PDO = 64
_RESERVED_TYPES = range(241, 254)
"""Transmission types that are reserved (241…251) or on remote request only (252, 253), which this drive does not have."""
_ID, _TYPE, _INHIBIT, _EVENT = 1, 2, 3, 5
_UNIT_OF_INHIBIT_NS = 100_000


def is_pdo_object(index: int) -> bool:
    """Whether an index is a communication or mapping record of one of the eight PDOs."""
    return index & 0xFFFC in (RPDO_COMMUNICATION, RPDO_MAPPING, TPDO_COMMUNICATION, TPDO_MAPPING)


def check_pdo_write(objects: ObjectDictionary, index: int, subindex: int, value: int) -> None:
    """Refuse what the standard forbids: remapping a valid PDO, entries while the count is not 0, too many bits.

    Raises:
        AbortError: with the abort code of the violated rule.
    """
    area, number = index & 0xFFFC, index & 3
    transmits = area >= TPDO_COMMUNICATION
    communication = (TPDO_COMMUNICATION if transmits else RPDO_COMMUNICATION) + number
    valid = not objects[communication, _ID] & NOT_VALID
    if area in (RPDO_MAPPING, TPDO_MAPPING):
        if valid:
            raise AbortError(codes.UNSUPPORTED_ACCESS)
        if subindex:
            if objects[index, 0]:
                raise AbortError(codes.UNSUPPORTED_ACCESS)
            if value:
                _mapped(objects, value, transmits)
        else:
            _check_count(objects, index, value, transmits)
    elif subindex == _ID:
        _check_cob_id(objects[index, _ID], value, valid)
    elif subindex == _TYPE and value in _RESERVED_TYPES:
        raise AbortError(codes.INVALID_VALUE)
    elif subindex == _INHIBIT and valid:
        raise AbortError(codes.UNSUPPORTED_ACCESS)


def _check_cob_id(old: int, new: int, valid: bool) -> None:
    identifier = new & 0x7FF
    if new & _EXTENDED or new & 0x1FFFF800 or not 0x181 <= identifier <= 0x57F:
        raise AbortError(codes.INVALID_VALUE)
    if valid and not new & NOT_VALID and identifier != old & 0x7FF:
        raise AbortError(codes.INVALID_VALUE)


def _check_count(objects: ObjectDictionary, index: int, count: int, transmits: bool) -> None:
    bits = 0
    for entry in range(1, count + 1):
        value = objects[index, entry]
        _mapped(objects, value, transmits)
        bits += value & 0xFF
    if bits > _BITS_IN_A_PDO:
        raise AbortError(codes.PDO_TOO_LONG)


def _mapped(objects: ObjectDictionary, value: int, transmits: bool) -> ODVariable:
    """The object of a mapping entry.

    Raises:
        AbortError: it does not exist, cannot be mapped in this direction, or has another length.
    """
    variable = objects.variable(value >> 16, value >> 8 & 0xFF)
    if not variable.pdo_mappable or not (variable.readable if transmits else variable.writable):
        raise AbortError(codes.NOT_MAPPABLE)
    if len(variable) != value & 0xFF:
        raise AbortError(codes.NOT_MAPPABLE)
    return variable


def compile_pdos(objects: ObjectDictionary, words: NDArray[np.int64]) -> None:
    """Write the tables of all eight PDOs into the block."""
    for number in range(8):
        transmits = number >= 4
        communication = (TPDO_COMMUNICATION if transmits else RPDO_COMMUNICATION) + number % 4
        mapping = (TPDO_MAPPING if transmits else RPDO_MAPPING) + number % 4
        base = w.PDO + number * w.PDO_WORDS
        cob_id = objects[communication, _ID]
        words[base + w.PDO_COB_ID] = -1 if cob_id & NOT_VALID else cob_id & 0x7FF
        words[base + w.PDO_TYPE] = objects[communication, _TYPE]
        words[base + w.PDO_COUNT] = count = objects[mapping, 0]
        first_bit = 0
        for entry in range(count):
            variable = _mapped(objects, objects[mapping, entry + 1], transmits)
            at = base + w.PDO_MAP + 4 * entry
            slot = objects.slot(variable.index, variable.subindex)
            signed = int(variable.data_type in SIGNED_TYPES)
            words[at : at + 4] = slot, first_bit, len(variable), signed
            first_bit += len(variable)
        words[base + w.PDO_BYTES] = (first_bit + 7) // 8
        words[base + w.PDO_EVENT_MS] = objects[communication, _EVENT]
        if transmits:
            words[base + w.PDO_INHIBIT_NS] = objects[communication, _INHIBIT] * _UNIT_OF_INHIBIT_NS
        elif not words[base + w.PDO_EVENT_MS]:
            words[w.TIMER + w.RPDO_TIMER + number] = w.NEVER
