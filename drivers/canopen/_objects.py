"""The drive's objects by SDO: read, write and verify, with errors for differences between EDS and drive."""

from __future__ import annotations

import struct
from typing import Final

import canopen
from canopen.objectdictionary import INTEGER_TYPES, ODVariable
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from drivers.canopen.profile import Setting
from drivers.interface import DriverError

ABSENT: Final = frozenset({0x06020000, 0x06090011})
"""SDO abort codes of an object or sub-index that does not exist (CiA 301, table 22)."""
SDO_TIMEOUT_S: Final = 0.5
"""Time-out while it is not known whether the node exists; two attempts."""
SLOW_S: Final = 3.0
"""Time-out of a node that exists and may be slow; one attempt, because it would reply to both."""


class Objects:
    """SDO access to one node.

    Args:
        node: the remote node with the EDS's object dictionary. eds: the EDS's path, for error texts.
    """

    def __init__(self, node: canopen.RemoteNode, eds: str) -> None:
        self._node = node
        self._eds = eds
        self.expect(there=False)

    def expect(self, *, there: bool) -> None:
        """Select the time-out: `SLOW_S` if the node is known to exist, else `SDO_TIMEOUT_S`."""
        self._node.sdo.RESPONSE_TIMEOUT = SLOW_S if there else SDO_TIMEOUT_S
        self._node.sdo.MAX_RETRIES = 1 if there else 2

    def known(self, index: int, sub: int = 0) -> bool:
        """Whether the EDS has the object."""
        return self._node.object_dictionary.get_variable(index, sub) is not None

    def variable(self, index: int, sub: int, what: str) -> ODVariable:
        """The object's description in the EDS.

        Raises:
            DriverError: it is missing in the EDS, or not an integer.
        """
        variable = self._node.object_dictionary.get_variable(index, sub)
        if variable is None:
            raise DriverError(f"{what} ({_name(index, sub)}) is missing in the EDS {self._eds}")
        if variable.data_type not in INTEGER_TYPES:
            raise DriverError(f"{what} ({_name(index, sub)}) is not an integer in the EDS {self._eds}")
        return variable

    def read(self, index: int, sub: int, what: str) -> int:
        """The object's value.

        Raises:
            DriverError: no reply, an object that does not exist, or another size than in the EDS.
        """
        variable = self.variable(index, sub, what)
        try:
            with self._node.sdo.open(index, sub, "rb", buffering=0) as stream:
                data = stream.read()
        except SdoAbortedError as abort:
            raise self._aborted(abort, index, sub, f"reading {what}") from abort
        except SdoCommunicationError as error:
            raise self._silent(index, sub, what) from error
        if 8 * len(data) != len(variable):
            raise DriverError(
                f"{what} ({_name(index, sub)}) has {len(variable) // 8} bytes in the EDS {self._eds}, but the drive "
                f"sends {len(data)}: this is not the drive's EDS"
            )
        return int(variable.decode_raw(data))

    def write(self, index: int, sub: int, value: int, what: str) -> None:
        """Write the object.

        Raises:
            DriverError: no reply, an object that does not exist, or a value that the drive refuses.
        """
        variable = self.variable(index, sub, what)
        try:
            data = variable.encode_raw(value)
        except (struct.error, ValueError) as error:
            raise DriverError(
                f"{what} ({_name(index, sub)}): {value} does not fit into the {len(variable)} bits of the EDS {self._eds}"
            ) from error
        try:
            self._node.sdo.download(index, sub, data)
        except SdoAbortedError as abort:
            raise self._aborted(abort, index, sub, f"writing {value} to {what}") from abort
        except SdoCommunicationError as error:
            raise self._silent(index, sub, what) from error

    def set(self, index: int, sub: int, value: int, what: str) -> None:
        """Write the object and read it back.

        Raises:
            DriverError: as :meth:`write`, or the drive keeps another value.
        """
        self.write(index, sub, value, what)
        kept = self.read(index, sub, what)
        if kept != value:
            raise DriverError(f"{what} ({_name(index, sub)}): {value} was written, but the drive keeps {kept}")

    def present(self, index: int, sub: int, what: str) -> bool:
        """Whether both the EDS and the drive have the object."""
        if not self.known(index, sub):
            return False
        try:
            self.read(index, sub, what)
        except DriverError as error:
            if isinstance(error.__cause__, SdoAbortedError) and error.__cause__.code in ABSENT:
                return False
            raise
        return True

    def apply(self, settings: tuple[Setting, ...]) -> None:
        """Write and verify the settings of a profile, without optional ones that do not exist."""
        for item in settings:
            if not item.optional or self.present(item.object, item.sub, item.what):
                self.set(item.object, item.sub, item.value, item.what)

    def _aborted(self, abort: SdoAbortedError, index: int, sub: int, doing: str) -> DriverError:
        if abort.code in ABSENT:
            return DriverError(
                f"{doing}: the drive has no object {_name(index, sub)}, though the EDS {self._eds} has it"
            )
        reason = SdoAbortedError.CODES.get(abort.code, "unknown reason")
        return DriverError(
            f"{doing} ({_name(index, sub)}): the drive refuses: {reason} (abort code 0x{abort.code:08x})"
        )

    def _silent(self, index: int, sub: int, what: str) -> DriverError:
        sdo = self._node.sdo
        twice = ", twice" if sdo.MAX_RETRIES > 1 else ""
        waited = f"{sdo.RESPONSE_TIMEOUT:g} s{twice}"
        return DriverError(f"node {self._node.id} sent no reply for {what} ({_name(index, sub)}) within {waited}")


def _name(index: int, sub: int) -> str:
    return f"0x{index:04x}" if sub == 0 else f"0x{index:04x}:{sub}"
