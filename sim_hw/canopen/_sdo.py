"""SDO server (CiA 301, 7.2.4): expedited and segmented transfers, one at a time, and the abort codes.

Block transfers are refused with "unknown command specifier", as by a server without them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from sim_hw.canopen.dictionary import AbortError

TOGGLE_ERROR = 0x05030000
UNKNOWN_COMMAND = 0x05040001
OUT_OF_MEMORY = 0x05040005

_HEADER = struct.Struct("<BHB")
_LONGEST = 256
"""Most bytes of a segmented download."""
_DOWNLOAD_SEGMENT, _DOWNLOAD, _UPLOAD, _UPLOAD_SEGMENT, _ABORT = range(5)
_EXPEDITED, _SIZED, _LAST, _TOGGLE = 0x02, 0x01, 0x01, 0x10


class SdoServer:
    """Answers requests of eight bytes with replies of eight bytes.

    Args:
        read, write: access to the objects, by index and sub-index; they raise :class:`AbortError` for a refusal.
    """

    def __init__(self, read: Callable[[int, int], bytes], write: Callable[[int, int, bytes], None]) -> None:
        self._read, self._write = read, write
        self._object = (0, 0)
        self._pending: bytes | None = None
        self._received: bytearray | None = None
        self._toggle = 0

    def reset(self) -> None:
        """Drop a transfer in progress."""
        self._pending = self._received = None

    def answer(self, request: bytes) -> bytes | None:
        """Reply to one request; None if there is none (the client aborts)."""
        if len(request) != 8:
            return self._abort(UNKNOWN_COMMAND)
        command = request[0]
        try:
            match command >> 5:
                case 1:
                    return self._download(request)
                case 2:
                    return self._upload(request)
                case 3:
                    return self._upload_segment(command)
                case 0:
                    return self._download_segment(request)
                case 4:
                    self.reset()
                    return None
                case _:
                    self._object = _HEADER.unpack_from(request)[1:]
                    return self._abort(UNKNOWN_COMMAND)
        except AbortError as refusal:
            return self._abort(refusal.code)

    def _abort(self, code: int) -> bytes:
        self.reset()
        return struct.pack("<BHBI", _ABORT << 5, *self._object, code)

    def _begin(self, request: bytes) -> int:
        command, index, subindex = _HEADER.unpack_from(request)
        self.reset()
        self._object = (index, subindex)
        self._toggle = 0
        return int(command)

    def _download(self, request: bytes) -> bytes:
        command = self._begin(request)
        if command & _EXPEDITED:
            size = 4 - (command >> 2 & 3) if command & _SIZED else 4
            self._write(*self._object, request[4 : 4 + size])
        else:
            if command & _SIZED and int.from_bytes(request[4:], "little") > _LONGEST:
                raise AbortError(OUT_OF_MEMORY)
            self._received = bytearray()
        return _HEADER.pack(_UPLOAD_SEGMENT << 5, *self._object) + bytes(4)

    def _download_segment(self, request: bytes) -> bytes:
        if self._received is None:
            raise AbortError(UNKNOWN_COMMAND)
        self._turn(request[0])
        self._received += request[1 : 8 - (request[0] >> 1 & 7)]
        if len(self._received) > _LONGEST:
            raise AbortError(OUT_OF_MEMORY)
        reply = bytes([_DOWNLOAD << 5 | request[0] & _TOGGLE]) + bytes(7)
        if request[0] & _LAST:
            self._write(*self._object, bytes(self._received))
            self.reset()
        return reply

    def _upload(self, request: bytes) -> bytes:
        self._begin(request)
        data = self._read(*self._object)
        if len(data) <= 4:
            command = _UPLOAD << 5 | (4 - len(data)) << 2 | _EXPEDITED | _SIZED
            return _HEADER.pack(command, *self._object) + data.ljust(4, b"\0")
        self._pending = data
        return _HEADER.pack(_UPLOAD << 5 | _SIZED, *self._object) + len(data).to_bytes(4, "little")

    def _upload_segment(self, command: int) -> bytes:
        if self._pending is None:
            raise AbortError(UNKNOWN_COMMAND)
        self._turn(command)
        part, self._pending = self._pending[:7], self._pending[7:]
        last = not self._pending
        reply = bytes([command & _TOGGLE | (7 - len(part)) << 1 | last]) + part.ljust(7, b"\0")
        if last:
            self.reset()
        return reply

    def _turn(self, command: int) -> None:
        if command & _TOGGLE != self._toggle:
            raise AbortError(TOGGLE_ERROR)
        self._toggle ^= _TOGGLE
