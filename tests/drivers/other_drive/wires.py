"""Ways to a bus: a Unix socket that is the bus, any interface of python-can, and a serial line adapter (slcan) on a pty."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import tty
from pathlib import Path
from typing import NamedTuple, Protocol

import can

_CAN_FRAME = struct.Struct("<LB3x8s")
_REMOTE_FLAG, _ERROR_FLAG, _BUS_OFF = 1 << 30, 1 << 29, 0x40


class Frame(NamedTuple):
    """A frame with an 11-bit identifier."""

    cob: int
    data: bytes = b""
    remote: bool = False


class Wire(Protocol):
    """What the drive hangs on."""

    def take(self, wait_s: float) -> list[Frame]:
        """What has come, after at most that long."""

    def put(self, frame: Frame) -> None:
        """Send to everybody."""

    def bus_off(self) -> None:
        """Tell the others' controllers that they are off the bus, where the wire can."""

    def cut(self) -> None:
        """Unplug."""


class Hub:
    """Listens on a path; each client's frames go to the drive and to every other client."""

    def __init__(self, path: Path) -> None:
        self._door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._door.bind(os.fspath(path))
        self._door.listen()
        self._clients: list[socket.socket] = []
        self._is_open = True

    def take(self, wait_s: float) -> list[Frame]:
        frames = []
        doors = [self._door] if self._is_open else []
        for ready in select.select([*doors, *self._clients], [], [], max(0.0, wait_s))[0]:
            if ready is self._door:
                client, _ = self._door.accept()
                client.setblocking(False)
                self._clients.append(client)
                continue
            try:
                packet = ready.recv(16)
            except OSError:
                packet = b""
            if not packet:
                self._clients.remove(ready)
                ready.close()
                continue
            self._spread(packet, ready)
            cob, length, data = _CAN_FRAME.unpack(packet)
            frames.append(Frame(cob & 0x7FF, data[:length], bool(cob & _REMOTE_FLAG)))
        return frames

    def _spread(self, packet: bytes, besides: socket.socket | None = None) -> None:
        for client in [one for one in self._clients if one is not besides]:
            # A bus waits for nobody who does not read; one who has left is noticed when all that he sent is read.
            with contextlib.suppress(OSError):
                client.send(packet)

    def put(self, frame: Frame) -> None:
        cob = frame.cob | (_REMOTE_FLAG if frame.remote else 0)
        self._spread(_CAN_FRAME.pack(cob, len(frame.data), frame.data))

    def bus_off(self) -> None:
        self._spread(_CAN_FRAME.pack(_ERROR_FLAG | _BUS_OFF, 8, bytes(8)))

    def cut(self) -> None:
        for client in self._clients:
            client.close()
        self._clients.clear()
        self._door.close()
        self._is_open = False


class PythonCan:
    """An interface of python-can."""

    def __init__(self, **arguments: object) -> None:
        self._bus = can.Bus(**arguments)  # type: ignore[arg-type]

    def take(self, wait_s: float) -> list[Frame]:
        message = self._bus.recv(max(0.0, wait_s))
        if message is None or message.is_extended_id or message.is_error_frame:
            return []
        return [Frame(message.arbitration_id, bytes(message.data), message.is_remote_frame)]

    def put(self, frame: Frame) -> None:
        self._bus.send(
            can.Message(arbitration_id=frame.cob, data=frame.data, is_remote_frame=frame.remote, is_extended_id=False)
        )

    def bus_off(self) -> None:
        """Nothing: these buses have no such frame."""

    def cut(self) -> None:
        self._bus.shutdown()


class SlcanAdapter:
    """A serial adapter's end of a pty: ASCII lines of the LAWICEL protocol, ended by a carriage return.

    Opened by O and closed by C; ``tIIILDD…`` is a frame, ``rIIIL`` a remote one.
    """

    def __init__(self, link: Path) -> None:
        self._end, host = os.openpty()
        tty.setraw(host)
        link.symlink_to(os.ttyname(host))
        self._kept_open = host  # or the end of the first user would hang up on us
        self._text = b""
        self._is_open = False

    def take(self, wait_s: float) -> list[Frame]:
        if not select.select([self._end], [], [], max(0.0, wait_s))[0]:
            return []
        *lines, self._text = (self._text + os.read(self._end, 4096)).split(b"\r")
        frames = []
        for line in (one.decode("ascii") for one in lines if one):
            if line[0] in "OC":
                self._is_open = line[0] == "O"
            elif line[0] in "tr" and self._is_open:
                length = int(line[4])
                data = bytes.fromhex(line[5 : 5 + 2 * length]) if line[0] == "t" else b""
                frames.append(Frame(int(line[1:4], 16), data, line[0] == "r"))
        return frames

    def put(self, frame: Frame) -> None:
        if self._is_open:
            kind = "r" if frame.remote else "t"
            os.write(self._end, f"{kind}{frame.cob:03X}{len(frame.data)}{frame.data.hex().upper()}\r".encode())

    def bus_off(self) -> None:
        """Nothing: an adapter of this kind only shows a light."""

    def cut(self) -> None:
        self._is_open = False
        os.close(self._end)
        os.close(self._kept_open)
