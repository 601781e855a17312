"""PDO mapping: TPDO 1 (and 2, for read-back) on every SYNC, RPDO 1 applied on receipt, all others off; all verified.

The order is that of CiA 301, 7.5.2.36: switch the PDO off, set the number of mapped objects to 0, write the entries, set
the number, then the transmission type, then switch it on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from drivers.canopen import layout as w
from drivers.canopen._objects import Objects
from drivers.interface import DriverError

_INVALID: Final = 0x80000000
_NO_RTR: Final = 0x40000000
_PDOS: Final = 4
_DEADLINE: Final = "deadline of RPDO 1 (event timer, ms)"
_ON_EVERY_SYNC, _ON_RECEIPT = 1, 255


@dataclass(frozen=True)
class Entry:
    """One object in a PDO."""

    index: int
    bits: int
    what: str


def map_pdos(
    objects: Objects,
    node_id: int,
    sample: tuple[Entry, ...],
    command: tuple[Entry, ...],
    back: tuple[Entry, ...] = (),
    deadline_ms: int = 0,
) -> None:
    """Map the PDOs of the cyclic exchange.

    Args:
        objects: the drive. node_id: its number. sample, command: the objects of TPDO 1 and RPDO 1, in order.
        back: the objects of TPDO 2, in order; none: no TPDO 2.
        deadline_ms: longest time between two RPDO 1 (0x1400:5), if the drive supervises it.

    Raises:
        DriverError: an object cannot be mapped, or the drive keeps another value.
    """
    _check_entries(objects, sample, "TPDO 1")
    _check_entries(objects, command, "RPDO 1")
    _check_entries(objects, back, "TPDO 2")
    for entry in sample:  # a drive may accept the mapping of a missing object, and send less
        objects.read(entry.index, 0, entry.what)
    for number in range(_PDOS):
        for base, name in ((0x1400, "RPDO"), (0x1800, "TPDO")):
            index, what = base + number, f"COB-ID of {name} {number + 1}"
            if number == 0 or objects.present(index, 1, what):
                cob_id = objects.read(index, 1, what)
                if not cob_id & _INVALID:
                    objects.set(index, 1, cob_id | _INVALID, what)
    for index, name in ((0x1800, "TPDO 1"), *(((0x1801, "TPDO 2"),) if back else ())):
        for sub, what in ((3, "inhibit time"), (5, "event timer")):
            if objects.present(index, sub, what):
                objects.set(index, sub, 0, f"{what} of {name}")
    _map(objects, 0x1800, w.TPDO1 + node_id, _ON_EVERY_SYNC, sample, "TPDO 1")
    if back:
        _map(objects, 0x1801, w.TPDO2 + node_id, _ON_EVERY_SYNC, back, "TPDO 2")
    set_deadline(objects, deadline_ms)
    _map(objects, 0x1400, w.RPDO1 + node_id, _ON_RECEIPT, command, "RPDO 1")


def set_deadline(objects: Objects, deadline_ms: int) -> None:
    """Set the drive's supervision of RPDO 1 (event timer, CiA 301, 7.5.2.35), if it has one; 0: off.

    Raises:
        DriverError: the drive keeps another time.
    """
    if objects.present(0x1400, 5, _DEADLINE):
        objects.set(0x1400, 5, deadline_ms, _DEADLINE)


def can_send(objects: Objects, entry: Entry) -> bool:
    """Whether EDS and drive have a TPDO 2, and an object that can be mapped into it."""
    return all(
        objects.present(*what) for what in ((entry.index, 0, entry.what), (0x1801, 1, "COB-ID of TPDO 2"))
    ) and bool(objects.variable(entry.index, 0, entry.what).pdo_mappable)


def _check_entries(objects: Objects, entries: tuple[Entry, ...], pdo: str) -> None:
    for entry in entries:
        variable = objects.variable(entry.index, 0, entry.what)
        if not variable.pdo_mappable:
            raise DriverError(
                f"{entry.what} (0x{entry.index:04x}) cannot be mapped into {pdo}: the EDS does not allow it"
            )
        if len(variable) != entry.bits:
            raise DriverError(
                f"{entry.what} (0x{entry.index:04x}) has {len(variable)} bits in the EDS; {pdo} has room for {entry.bits}"
            )


def _map(objects: Objects, index: int, cob_id: int, kind: int, entries: tuple[Entry, ...], pdo: str) -> None:
    mapping = index + 0x200
    objects.set(mapping, 0, 0, f"number of objects in {pdo}")
    for sub, entry in enumerate(entries, start=1):
        value = entry.index << 16 | entry.bits
        objects.set(mapping, sub, value, f"mapping of {entry.what} (0x{entry.index:04x}) into {pdo}")
    objects.set(mapping, 0, len(entries), f"number of objects in {pdo}")
    objects.set(index, 2, kind, f"transmission type of {pdo}")
    # The bit for remote requests is not changed.
    kept = objects.read(index, 1, f"COB-ID of {pdo}") & _NO_RTR
    objects.set(index, 1, cob_id | kept, f"COB-ID of {pdo}")
