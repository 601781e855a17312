"""A host for the serial board, written from docs/protocols/serial-dac.md alone: no driver and no code of the board's."""

import os
import select
import struct
import time
import tty
from dataclasses import dataclass
from pathlib import Path

from tests.polling import PATIENCE_S

ENABLED, WATCHDOG, ENCODER_FAULT, AMPLIFIER_FAULT = 1, 2, 4, 8
BAD_FRAME, REJECTED, EXTERNAL_STOP, UNCONFIGURED = 16, 32, 64, 128
MIDDLE = 1 << 13


def crc(data: bytes) -> int:
    value = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            top = (value >> 15) ^ ((byte >> bit) & 1)
            value = ((value << 1) & 0xFFFF) ^ (0x1021 if top else 0)
    return value


def stuffed(payload: bytes) -> bytes:
    pieces = (payload + struct.pack("<H", crc(payload))).split(b"\0")
    return b"".join(bytes([len(piece) + 1]) + piece for piece in pieces) + b"\0"


def unstuffed(frame: bytes) -> bytes | None:
    """The payload of what stood before a delimiter; None when it is bad."""
    pieces = []
    while frame:
        length = frame[0]
        if length == 0 or length > len(frame):
            return None
        pieces.append(frame[1:length])
        frame = frame[length:]
    data = b"\0".join(pieces)
    if len(data) < 3 or crc(data[:-2]) != struct.unpack("<H", data[-2:])[0]:
        return None
    return data[:-2]


@dataclass
class Hello:
    version: int
    nonce: int
    dac_bits: int
    full_scale_ua: int
    counter_bits: int
    watchdog_min_ms: int
    watchdog_max_ms: int
    serial_number: int
    firmware: int


@dataclass
class Sample:
    seq: int
    count: int
    time_us: int
    status: int
    command_seq: int


class Host:
    """Talks to a board over a port's path; every reply is awaited for ``timeout_s`` at most."""

    def __init__(self, path: Path, timeout_s: float = PATIENCE_S) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.fd)
        self.timeout_s = timeout_s
        self.seq = 0
        self.bad = 0
        self.frame = b""
        """The last good frame as it was on the line, its delimiter included."""
        self._waiting = b""
        self.put(b"\0")

    def close(self) -> None:
        os.close(self.fd)

    def put(self, data: bytes) -> None:
        assert os.write(self.fd, data) == len(data)

    def send(self, payload: bytes) -> None:
        self.put(stuffed(payload))

    def receive(self, timeout_s: float | None = None) -> bytes | None:
        """Next good payload, or None when none comes in time; bad frames are counted."""
        end = time.monotonic() + (self.timeout_s if timeout_s is None else timeout_s)
        while True:
            while b"\0" in self._waiting:
                frame, _, self._waiting = self._waiting.partition(b"\0")
                if not frame:
                    continue
                if (payload := unstuffed(frame)) is not None:
                    self.frame = frame + b"\0"
                    return payload
                self.bad += 1
            left = end - time.monotonic()
            if left <= 0 or not select.select([self.fd], [], [], left)[0]:
                return None
            self._waiting += os.read(self.fd, 4096)

    def hello(self, nonce: int = 0x1234, version: int = 1) -> Hello:
        self.send(struct.pack("<BBH", 0x01, version, nonce))
        reply = self.receive()
        assert reply is not None
        assert len(reply) == 20
        kind, *fields = struct.unpack("<BBHBIBHHIH", reply)
        assert kind == 0x81
        return Hello(*fields)

    def configure(self, watchdog_ms: int) -> int:
        self.send(struct.pack("<BH", 0x02, watchdog_ms))
        reply = self.receive()
        assert reply is not None
        kind, accepted = struct.unpack("<BH", reply)
        assert kind == 0x82
        return int(accepted)

    def ask(self) -> int:
        self.seq = (self.seq + 1) & 0xFF
        self.send(bytes([0x03, self.seq]))
        return self.seq

    def reply(self, timeout_s: float | None = None) -> Sample | None:
        payload = self.receive(timeout_s)
        if payload is None:
            return None
        assert len(payload) == 12
        assert payload[0] == 0x83
        return Sample(*struct.unpack("<xBIIBB", payload))

    def sample(self) -> Sample:
        seq = self.ask()
        answer = self.reply()
        assert answer is not None
        assert answer.seq == seq
        return answer

    def inputs(self) -> tuple[Sample, int]:
        """A sample, and the inputs that came with it."""
        self.seq = (self.seq + 1) & 0xFF
        self.send(bytes([0x05, self.seq]))
        payload = self.receive()
        assert payload is not None
        assert len(payload) == 13
        assert payload[0] == 0x84
        return Sample(*struct.unpack("<xBIIBB", payload[:12])), payload[12]

    def command(self, code: int, flags: int = 1) -> None:
        self.send(struct.pack("<BBHB", 0x04, self.seq, code, flags))

    def begin(self, watchdog_ms: int = 20) -> None:
        """Session steps 2 to 4."""
        self.hello()
        assert self.configure(watchdog_ms) == watchdog_ms
        self.command(MIDDLE, 0)
