"""python-can interface ``unix_seqpacket``: CAN frames over an AF_UNIX SOCK_SEQPACKET connection.

For a kernel without CAN: one message of such a socket is one 16-byte Linux ``struct can_frame``, exactly as on a
SocketCAN descriptor, so that the same compiled exchange and bring-up work with both. The peer listens on the
path and is the bus. ``can.Bus(interface="unix_seqpacket", channel="/run/user/1000/drive.sock")``
"""

from __future__ import annotations

import math
import os
import select
import socket
import struct
import time

import can

_FRAME = struct.Struct("=IB3x8s")
"""``struct can_frame`` (linux/can.h): identifier with flags, length, three bytes of padding, eight of data."""
_EFF, _RTR, _ERR = 0x80000000, 0x40000000, 0x20000000
_SFF_MASK, _EFF_MASK = 0x7FF, 0x1FFFFFFF


def pack(message: can.Message) -> bytes:
    """A classic CAN message as the 16 bytes of ``struct can_frame``."""
    identifier = message.arbitration_id
    if message.is_extended_id:
        identifier |= _EFF
    if message.is_remote_frame:
        identifier |= _RTR
    if message.is_error_frame:
        identifier |= _ERR
    return _FRAME.pack(identifier, message.dlc, b"" if message.is_remote_frame else bytes(message.data))


def unpack(frame: bytes, timestamp: float = 0.0) -> can.Message:
    """The message in the 16 bytes of a ``struct can_frame``.

    Raises:
        can.CanOperationError: not 16 bytes, or a length beyond 8.
    """
    if len(frame) != _FRAME.size:
        raise can.CanOperationError(f"a CAN frame is {_FRAME.size} bytes long, this message has {len(frame)}")
    identifier, length, data = _FRAME.unpack(frame)
    if length > 8:
        raise can.CanOperationError(f"a classic CAN frame has at most 8 bytes of data, this one has {length}")
    extended, remote = bool(identifier & _EFF), bool(identifier & _RTR)
    return can.Message(
        timestamp=timestamp,
        arbitration_id=identifier & (_EFF_MASK if extended or identifier & _ERR else _SFF_MASK),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=bool(identifier & _ERR),
        dlc=length,
        data=None if remote else data[:length],
    )


class SeqpacketBus(can.BusABC):
    """A CAN bus behind a Unix socket.

    Args:
        channel: path of the listening SOCK_SEQPACKET socket.
        can_filters: as in python-can; applied in Python.

    Raises:
        can.CanInitializationError: nobody listens on the path.
    """

    def __init__(self, channel: str, can_filters: can.typechecking.CanFilters | None = None, **_: object) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._socket.connect(os.fspath(channel))
        except OSError as exception:
            self._socket.close()
            raise can.CanInitializationError(
                f"no CAN bus on the socket {channel}: {exception.strerror or exception}", exception.errno
            ) from exception
        self.channel_info = f"unix_seqpacket {channel}"
        super().__init__(channel=channel, can_filters=can_filters)

    def fileno(self) -> int:
        """The descriptor; each message is one 16-byte ``struct can_frame``. -1 after shutdown."""
        return self._socket.fileno()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one frame, waiting at most ``timeout`` s (None: no limit) for space in the buffer.

        Raises:
            can.CanOperationError: the peer has closed, or the buffer stayed full.
        """
        self._wait(select.POLLOUT, timeout, "no room to send within")
        try:
            self._socket.send(pack(msg))
        except OSError as exception:
            raise can.CanOperationError(f"{self.channel_info}: {exception.strerror}", exception.errno) from exception

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._wait(select.POLLIN, timeout):
            return None, False
        try:
            frame = self._socket.recv(_FRAME.size + 1)
        except OSError as exception:
            raise can.CanOperationError(f"{self.channel_info}: {exception.strerror}", exception.errno) from exception
        if not frame:
            raise can.CanOperationError(f"{self.channel_info}: the other side has closed the bus")
        return unpack(frame, time.time()), False

    def _wait(self, event: int, timeout: float | None, failure: str | None = None) -> bool:
        if self._socket.fileno() < 0:
            raise can.CanOperationError(f"{self.channel_info}: shut down")
        poll = select.poll()
        poll.register(self._socket, event)
        ready = bool(poll.poll(None if timeout is None else math.ceil(max(timeout, 0.0) * 1e3)))
        if failure and not ready:
            raise can.CanOperationError(f"{self.channel_info}: {failure} {timeout:g} s")
        return ready

    def shutdown(self) -> None:
        """Close the connection; safe to call twice."""
        super().shutdown()
        self._socket.close()
