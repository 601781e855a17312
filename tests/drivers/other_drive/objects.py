"""The objects of CiA 402 and of Copley that the drive has beside durand's own, and the dictionary that may lack some."""

from __future__ import annotations

from typing import Any

from durand.datatypes import DatatypeEnum as Type
from durand.object_dictionary import ObjectDictionary

CYCLIC_TORQUE = 10
FIRST_INPUT = 0x10000
_RO, _RW = "ro", "rw"
OBJECTS: dict[int, tuple[str, Type, str, int]] = {
    0x100C: ("guard time", Type.UNSIGNED16, _RW, 0),
    0x100D: ("life time factor", Type.UNSIGNED8, _RW, 0),
    0x1006: ("communication cycle period", Type.UNSIGNED32, _RW, 0),
    0x6007: ("abort connection option code", Type.INTEGER16, _RW, 1),
    0x603F: ("error code", Type.UNSIGNED16, _RO, 0),
    0x6040: ("controlword", Type.UNSIGNED16, _RW, 0),
    0x6041: ("statusword", Type.UNSIGNED16, _RO, 0),
    0x605A: ("quick stop option code", Type.INTEGER16, _RW, 2),
    0x605E: ("fault reaction option code", Type.INTEGER16, _RW, 2),
    0x6060: ("modes of operation", Type.INTEGER8, _RW, 0),
    0x6061: ("modes of operation display", Type.INTEGER8, _RO, 0),
    0x6063: ("position actual internal value", Type.INTEGER32, _RO, 0),
    0x6064: ("position actual value", Type.INTEGER32, _RO, 0),
    0x6071: ("target torque", Type.INTEGER16, _RW, 0),
    0x6072: ("max torque", Type.UNSIGNED16, _RW, 5000),
    0x6073: ("max current", Type.UNSIGNED16, _RW, 3000),
    0x6074: ("torque demand", Type.INTEGER16, _RO, 0),
    0x6075: ("motor rated current", Type.UNSIGNED32, _RW, 2000),
    0x6076: ("motor rated torque", Type.UNSIGNED32, _RW, 58),
    0x6077: ("torque actual value", Type.INTEGER16, _RO, 0),
    0x6087: ("torque slope", Type.UNSIGNED32, _RW, 1000),
    0x60FD: ("digital inputs", Type.UNSIGNED32, _RO, FIRST_INPUT),
    0x6502: ("supported drive modes", Type.UNSIGNED32, _RO, 1 << CYCLIC_TORQUE - 1),
    0x2110: ("peak current limit", Type.INTEGER16, _RW, 600),
    0x2111: ("continuous current limit", Type.INTEGER16, _RW, 200),
    0x2112: ("time at peak", Type.UNSIGNED16, _RW, 1000),
    0x2113: ("current ramp", Type.UNSIGNED32, _RW, 1000),
    0x221C: ("actual motor current", Type.INTEGER16, _RO, 0),
    0x2300: ("desired state", Type.UNSIGNED16, _RW, 30),
    0x2340: ("programmed current", Type.INTEGER16, _RW, 0),
}
RECORDS: dict[int, dict[int, tuple[str, Type, str, int]]] = {
    0x1016: {1: ("consumer heartbeat time", Type.UNSIGNED32, _RW, 0)},
    0x1029: {1: ("communication error", Type.UNSIGNED8, _RW, 0)},
    0x608F: {
        1: ("encoder increments", Type.UNSIGNED32, _RO, 8192),
        2: ("motor revolutions", Type.UNSIGNED32, _RO, 1),
    },
}


class Objects(ObjectDictionary):
    """durand's dictionary, without the objects that this drive shall not have."""

    def __init__(self, missing: set[int]) -> None:
        super().__init__()
        self._missing = missing

    def lookup(self, index: int, subindex: int | None = None) -> Any:
        if index in self._missing:
            raise KeyError(index)
        return super().lookup(index, subindex)


def key_of(name: int | str) -> tuple[int, int]:
    """``0x1018:1`` or a number as index and sub-index."""
    if isinstance(name, int):
        return name, 0
    index, _, sub = name.partition(":")
    return int(index, 0), int(sub or "0", 0)
