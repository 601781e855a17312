"""The drive's bus: a Unix socket or SocketCAN served by compiled code, any other python-can interface by Python."""

from __future__ import annotations

import contextlib
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import can
import numpy as np

from sim_hw import layout as common
from sim_hw.canopen import layout as w
from sim_hw.canopen._receiving import let_go, receive
from sim_hw.canopen._sending import ERROR, EXTENDED, REMOTE, header
from sim_hw.canopen._timeline import next_wake
from sim_hw.canopen.serve import CLIENTS, DESCRIPTOR_WORDS, LISTENER, hang_up, serve

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sim_hw.canopen.device import Drive

_LOOK_AGAIN_NS = 50_000_000
"""Longest time until Python checks the STOP word and an unplugged cable."""


class Compiled:
    """A bus served by compiled code, with descriptors for ``struct can_frame``."""

    def __init__(self) -> None:
        self._fds = np.full(DESCRIPTOR_WORDS, -1, np.int64)

    def serve(self, drive: Drive) -> None:
        """Serve until ``STOP`` is set."""
        timespec = np.zeros(2, np.int64)
        machine = drive.machine
        while not machine.sim.s[common.STOP]:
            serve(machine, self._fds, timespec, time.monotonic_ns() + _LOOK_AGAIN_NS)
            drive.attend()
            self._plug(time.monotonic_ns() >= machine.d[w.UNPLUGGED_UNTIL_NS])
        drive.end()

    def _plug(self, plugged: bool) -> None:
        """Nothing to do: frames of an unplugged bus are ignored."""

    def close(self) -> None:
        """Close all connections; safe to call twice."""
        for client in range(CLIENTS):
            hang_up(self._fds, client)


class UnixBus(Compiled):
    """An AF_UNIX SOCK_SEQPACKET socket as the bus for up to four clients.

    Args:
        path: of the socket; an old one without a listener is replaced.

    Raises:
        OSError: the path cannot be bound, or another process listens on it.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._listener: socket.socket | None = None
        _remove_stale(path)
        self._listen()

    def _listen(self) -> None:
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            listener.bind(str(self._path))
            listener.listen(CLIENTS)
        except OSError as error:
            listener.close()
            raise OSError(error.errno, f"cannot listen on {self._path}: {error.strerror}") from error
        listener.setblocking(False)
        self._listener = listener
        self._fds[LISTENER] = listener.fileno()

    def _plug(self, plugged: bool) -> None:
        """Remove the socket when it is unplugged, and create it again when it is plugged in."""
        if plugged and self._listener is None:
            self._listen()
        elif not plugged and self._listener is not None:
            self.close()

    def close(self) -> None:
        """Remove the socket, then close all connections, so that a client finds no socket. Safe to call twice."""
        if self._listener is not None:
            self._path.unlink(missing_ok=True)
            self._listener.close()
            self._listener = None
        self._fds[LISTENER] = -1
        super().close()


def _remove_stale(path: Path) -> None:
    if path.is_socket():
        with contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)) as probe:
            try:
                probe.connect(str(path))
            except ConnectionRefusedError:
                path.unlink()


class CanSocket(Compiled):
    """A raw SocketCAN socket, served compiled.

    Args:
        channel: network interface, such as ``vcan0``.

    Raises:
        OSError: this kernel has no CAN, or there is no such interface.
    """

    def __init__(self, channel: str) -> None:
        super().__init__()
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as found:
            try:
                found.bind((channel,))
            except OSError as error:
                raise OSError(error.errno, f"cannot open {channel}: {error.strerror}") from error
            self._fds[0] = found.detach()


class PythonCan:
    """Any interface of python-can, served by a Python loop with the compiled drive.

    Args:
        interface: name of the interface, such as ``udp_multicast``. channel: of that interface.
        arguments: further ones of that interface.

    Raises:
        OSError: the interface cannot be opened, or does not take the arguments.
    """

    def __init__(self, interface: str, channel: str, arguments: Mapping[str, Any]) -> None:
        try:
            self._bus = can.Bus(channel=channel, interface=interface, **arguments)
        except (can.CanError, TypeError, ValueError) as error:
            given = "".join(f" {name}={value}" for name, value in arguments.items())
            raise OSError(f"cannot open {interface} {channel}{given}: {error}") from error

    def serve(self, drive: Drive) -> None:
        """Wait for a frame or for the drive's next event, reply, and repeat."""
        machine = drive.machine
        while not machine.sim.s[common.STOP]:
            wait_ns = min(next_wake(machine) - time.monotonic_ns(), _LOOK_AGAIN_NS)
            message = self._bus.recv(max(wait_ns, 0) * 1e-9)
            now = time.monotonic_ns()
            if message is not None and not message.is_fd:
                receive(machine, *_words(message), now)
            let_go(machine, now)
            drive.attend()
            for frame in _drain(drive):
                with contextlib.suppress(can.CanError):
                    self._bus.send(frame)
        drive.end()

    def close(self) -> None:
        """Shut the interface down."""
        self._bus.shutdown()


def _words(message: can.Message) -> tuple[int, int]:
    flags = EXTENDED * message.is_extended_id | REMOTE * message.is_remote_frame | ERROR * message.is_error_frame
    data = int.from_bytes(bytes(message.data or b"").ljust(8, b"\0"), "little", signed=True)
    return header(message.arbitration_id | flags, message.dlc), data


def _drain(drive: Drive) -> Iterator[can.Message]:
    machine = drive.machine
    for low, data in machine.out[: machine.d[w.OUT_COUNT]].tolist():
        length = low >> 32 & 0xFF
        yield can.Message(
            arbitration_id=low & 0x1FFFFFFF,
            is_extended_id=bool(low & EXTENDED),
            is_error_frame=bool(low & ERROR),
            dlc=length,
            data=(data & (1 << 64) - 1).to_bytes(8, "little")[:length],
        )
    machine.d[w.OUT_COUNT] = 0


def open_transport(
    path: Path | None, interface: str | None, channel: str | None, arguments: Mapping[str, Any]
) -> Compiled | PythonCan:
    """The transport of the command line; ``arguments`` are further ones of a python-can interface.

    Raises:
        OSError: it cannot be opened.
    """
    if path is not None:
        return UnixBus(path)
    if interface == "socketcan":
        return CanSocket(channel or "can0")
    return PythonCan(interface or "", channel or "", arguments)
