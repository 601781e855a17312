"""The python-can interface ``unix_seqpacket``: the bytes of ``struct can_frame``, and what a vanished peer looks like."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from drivers.seqpacket_bus import SeqpacketBus, pack, unpack

FRAMES = [
    ("81 01 00 00 02 00 00 00 2f 06 00 00 00 00 00 00", can.Message(0, 0x181, False, dlc=2, data=[0x2F, 6])),
    ("01 07 00 40 00 00 00 00 00 00 00 00 00 00 00 00", can.Message(0, 0x701, False, True, dlc=0)),
    ("78 56 34 92 08 00 00 00 01 02 03 04 05 06 07 08", can.Message(0, 0x12345678, True, data=range(1, 9))),
    ("40 00 00 20 08 00 00 00 00 00 00 00 00 00 00 00", can.Message(0, 0x40, False, False, True, data=bytes(8))),
]


@pytest.mark.parametrize(("frame", "message"), FRAMES)
def test_bytes_of_a_frame(frame: str, message: can.Message) -> None:
    assert pack(message) == bytes.fromhex(frame)
    assert unpack(bytes.fromhex(frame)).equals(message, timestamp_delta=None)


@pytest.mark.parametrize(("frame", "text"), [(b"\0" * 15, "has 15"), (b"\0\0\0\0\x09" + b"\0" * 11, "this one has 9")])
def test_what_is_no_frame_is_refused(frame: bytes, text: str) -> None:
    with pytest.raises(can.CanOperationError, match=text):
        unpack(frame)


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
        listening.bind(str(tmp_path / "bus"))
        listening.listen(1)
        yield listening


def test_found_by_python_can_and_carries_frames_both_ways(listener: socket.socket) -> None:
    with can.Bus(interface="unix_seqpacket", channel=listener.getsockname()) as bus:
        assert isinstance(bus, SeqpacketBus)
        assert bus.fileno() >= 0
        peer, _ = listener.accept()
        with peer:
            bus.send(FRAMES[0][1], timeout=1.0)
            assert peer.recv(64) == bytes.fromhex(FRAMES[0][0])
            assert bus.recv(0.0) is None
            peer.send(bytes.fromhex(FRAMES[1][0]))
            received = bus.recv(1.0)
            assert received is not None
            assert received.is_remote_frame
            assert received.arbitration_id == 0x701
        with pytest.raises(can.CanOperationError, match="closed the bus"):
            bus.recv(1.0)
        with pytest.raises(can.CanOperationError, match="Broken pipe"):
            bus.send(FRAMES[0][1])
    with pytest.raises(can.CanOperationError, match="shut down"):
        bus.recv(0.0)


def test_nobody_listens(tmp_path: Path) -> None:
    with pytest.raises(can.CanInitializationError, match=r"no CAN bus on the socket .*nobody: No such file"):
        SeqpacketBus(str(tmp_path / "nobody"))
