"""The object dictionary of the simulated drive: the EDS in this folder, with its values in the words of compiled code."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from canopen import objectdictionary
from canopen.objectdictionary import ODVariable, datatypes

from hapticd.config import ConfigError, Problem
from sim_hw.canopen import layout as w

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy as np
    from numpy.typing import NDArray

EDS = Path(__file__).with_name("drive.eds")
"""Electronic data sheet of the simulated drive."""

UNSUPPORTED_ACCESS = 0x06010000
READ_OF_WRITE_ONLY = 0x06010001
WRITE_OF_READ_ONLY = 0x06010002
NO_OBJECT = 0x06020000
NOT_MAPPABLE = 0x06040041
PDO_TOO_LONG = 0x06040042
LENGTH_TOO_HIGH = 0x06070012
LENGTH_TOO_LOW = 0x06070013
NO_SUBINDEX = 0x06090011
INVALID_VALUE = 0x06090030
VALUE_TOO_HIGH = 0x06090031
VALUE_TOO_LOW = 0x06090032


_ABSENT = f"the drive has no such object; its objects are those of {EDS.name}"


def _name(index: int, subindex: int) -> str:
    return f"0x{index:04X}:{subindex}" if subindex else f"0x{index:04X}"


class AbortError(Exception):
    """An access that the drive refuses; ``code`` is the SDO abort code of CiA 301."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


class ObjectDictionary:
    """Objects and their present values.

    Args:
        words: the drive's block (:mod:`sim_hw.canopen.layout`); its first words are the numeric objects.
        node_id: for the COB-IDs that depend on it.
        values: power-up values that differ from the EDS, by (index, sub-index).
        missing: indexes that this drive does not have.
    """

    def __init__(
        self,
        words: NDArray[np.int64],
        node_id: int,
        values: Mapping[tuple[int, int], int] | None = None,
        missing: Iterable[int] = (),
    ) -> None:
        self._words = words
        self._objects = objectdictionary.import_od(str(EDS), node_id)
        self._power_up = dict(values or {})
        self._missing = frozenset(missing)
        self._slots = {key: slot for slot, key in enumerate(w.KNOWN_OBJECTS)}
        for variable in self._variables():
            if variable.data_type in datatypes.INTEGER_TYPES:
                self._slots.setdefault((variable.index, variable.subindex), len(self._slots))
        self.load_defaults()

    def _variables(self) -> list[ODVariable]:
        found: list[ODVariable] = []
        for entry in self._objects.values():
            found.extend([entry] if isinstance(entry, ODVariable) else entry.values())
        return found

    def load_defaults(self, below: int = 0x10000) -> None:
        """Power-up values of every object with an index less than ``below``."""
        for variable in self._variables():
            key = (variable.index, variable.subindex)
            if variable.index < below and key in self._slots:
                self._words[self._slots[key]] = self._power_up.get(key, variable.default or 0)

    def check(self, source: str, values: Mapping[tuple[int, int], int], missing: Iterable[int]) -> None:
        """Refuse invalid arguments: power-up values out of range, and missing objects that do not exist.

        Args:
            source: of the arguments, for the message. values: power-up values by (index, sub-index). missing: indexes.

        Raises:
            ConfigError: with everything that is wrong.
        """
        found = [
            Problem(source, _name(*key), str(value), message)
            for key, value in values.items()
            if (message := self._refusal(*key, value)) is not None
        ]
        found += [
            Problem(source, f"0x{index:04X}", None, f"cannot be missing: {_ABSENT}")
            for index in missing
            if index not in self._objects
        ]
        if found:
            raise ConfigError(found)

    def _refusal(self, index: int, subindex: int, value: int) -> str | None:
        """Why an object cannot have a power-up value, in words; None if it can."""
        if index in self._missing:
            return "is given a value, and as missing"
        try:
            variable = self.variable(index, subindex)
        except AbortError as abort:
            return _ABSENT if abort.code == NO_OBJECT else "the object has no such sub-index"
        if (index, subindex) not in self._slots:
            return "is a text, not a number"
        bits, signed = len(variable), variable.data_type in datatypes.SIGNED_TYPES
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
        return None if low <= value <= high else f"must be between {low} and {high}: it has {bits} bits"

    def variable(self, index: int, subindex: int) -> ODVariable:
        """Description of one object.

        Raises:
            AbortError: there is no such object, or no such sub-index.
        """
        if index in self._missing or index not in self._objects:
            raise AbortError(NO_OBJECT)
        entry: Any = self._objects[index]
        if isinstance(entry, ODVariable):
            if subindex:
                raise AbortError(NO_SUBINDEX)
            return entry
        if subindex not in entry.subindices:
            raise AbortError(NO_SUBINDEX)
        variable: ODVariable = entry.subindices[subindex]
        return variable

    def slot(self, index: int, subindex: int) -> int:
        """Word of the block that holds a numeric object."""
        return self._slots[(index, subindex)]

    def __getitem__(self, key: tuple[int, int]) -> int:
        return int(self._words[self._slots[key]])

    def __setitem__(self, key: tuple[int, int], value: int) -> None:
        self._words[self._slots[key]] = value

    def read(self, index: int, subindex: int) -> bytes:
        """Value as bytes on the bus.

        Raises:
            AbortError: the access is refused.
        """
        variable = self.variable(index, subindex)
        if not variable.readable:
            raise AbortError(READ_OF_WRITE_ONLY)
        if (index, subindex) not in self._slots:
            return str(variable.default).encode("ascii")
        size = len(variable) // 8
        value = self[(index, subindex)] & ((1 << 8 * size) - 1)
        return value.to_bytes(size, "little")

    def decode(self, index: int, subindex: int, data: bytes) -> int:
        """Number in a download.

        Raises:
            AbortError: read-only, of the wrong length, or out of the object's range.
        """
        variable = self.variable(index, subindex)
        if not variable.writable:
            raise AbortError(WRITE_OF_READ_ONLY)
        size = len(variable) // 8
        if len(data) != size:
            raise AbortError(LENGTH_TOO_HIGH if len(data) > size else LENGTH_TOO_LOW)
        value = int.from_bytes(data, "little", signed=variable.data_type in datatypes.SIGNED_TYPES)
        if variable.max is not None and value > variable.max:
            raise AbortError(VALUE_TOO_HIGH)
        if variable.min is not None and value < variable.min:
            raise AbortError(VALUE_TOO_LOW)
        return value
