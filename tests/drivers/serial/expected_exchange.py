"""``expected_exchange``: a driver test states the exact bytes on the line, one pair an exchange, and nothing else."""

import ctypes
import os
import pty
import select
import struct
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from drivers.interface import X_CODE, X_CURRENT, X_ENABLE, X_PERIOD_NS, new_exchange
from drivers.serial_dac import SerialDacDriver
from drivers.serial_dac.state import S_BAD_FRAMES, S_STALE
from hapticd.config import Config, parse_config
from tests.drivers.serial.reference import framed
from tests.polling import PATIENCE_S


class HangUp:
    """As a reply: the board's side of the line is gone; ``done`` says when."""

    def __init__(self) -> None:
        self.done = threading.Event()


Pair = tuple[str, str | bytes | HangUp]

RATE_HZ = 10.0
IMPATIENT_S = 0.06
"""Period of a read that has no reply to wait for."""
_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)
HELLO = "00 07 01 01 34 12 66 3e 00"
OPENING = [
    (HELLO, "09 81 01 34 12 0e 80 8d 5b 03 20 05 05 e8 03 ef be 01 05 02 01 4e 8f 00"),  # 14 bits, 6 A, 32-bit counter
    ("03 02 c8 03 01 3d 00", "03 82 c8 03 5b 06 00"),  # watchdog 200 ms
    ("03 04 01 02 20 03 58 e8 00", ""),  # COMMAND: seq 1, mid-scale, disable
    ("05 03 01 7d 58 00", "04 83 01 64 01 01 03 e8 03 01 01 04 01 25 6d 00"),  # SAMPLE 1: count 100, off
]
"""The bytes of a good beginning, the host's and the board's."""
CLOSING_1 = [("00 03 04 01 02 20 03 58 e8 00", ""), ("03 04 01 02 20 03 58 e8 00", "")]
"""Twice mid-scale and disable, after an end for whatever was half sent; seq 1."""
CLOSING_2 = [("00 03 04 02 02 20 03 84 73 00", ""), ("03 04 02 02 20 03 84 73 00", "")]
SAMPLE_2 = "05 03 02 1e 68 00"
COMMAND_2 = "08 04 02 ab 22 01 aa 48 00"
"""seq 2, code 8192 + 683, enable."""


def config(port: str = "/dev/null", **changes: Any) -> Config:
    """A config for a board of 14 bits and ± 6 A."""
    driver = {"name": "serial_dac", "port": port, "watchdog_ms": 200}
    document: dict[str, Any] = {"servo": {"rate_hz": RATE_HZ}, **changes}
    document["driver"] = {**driver, **changes.get("driver", {})}
    document["driver"] = {key: value for key, value in document["driver"].items() if value is not ...}
    return parse_config(document, "test")


def reply(seq: int, count: int, status: int = 0, command_seq: int = 1) -> bytes:
    """A SAMPLE reply as the board frames it."""
    return framed(struct.pack("<BBIIBB", 0x83, seq, count & 0xFFFFFFFF, 1000 * seq, status, command_seq))


def hello_reply(version: int = 1, nonce: int = 0x1234, **changes: int) -> bytes:
    """A HELLO reply as the board frames it."""
    fields = {
        "bits": 14,
        "scale": 6_000_000,
        "counter": 32,
        "least": 5,
        "most": 1000,
        "serial": 0xBEEF,
        "firmware": 258,
    }
    return framed(struct.pack("<BBHBIBHHIH", 0x81, version, nonce, *{**fields, **changes}.values()))


class Loop:
    """Calls an open driver as the servo loop does; a read waits most of its period, so that a peer in Python is in time."""

    def __init__(self, driver: SerialDacDriver) -> None:
        self.driver = driver
        self.x = new_exchange()
        self.floats = self.x.view("f8")

    def read(self, period_s: float = PATIENCE_S) -> int:
        self.floats[X_PERIOD_NS] = 1e9 * period_s
        return int(_FUNCTION(self.driver.read_address)(self.driver.state_address, self.x.ctypes.data))

    def write(self, code: int, enable: int) -> int:
        self.x[X_CODE], self.x[X_ENABLE] = code, enable
        self.floats[X_CURRENT] = code * 6.0 / 8192
        return int(_FUNCTION(self.driver.write_address)(self.driver.state_address, self.x.ctypes.data))


def line_errors(driver: SerialDacDriver) -> tuple[int, int]:
    """Replies that came too late or twice, and bad frames, since the driver was opened."""
    return int(driver._state[S_STALE]), int(driver._state[S_BAD_FRAMES])


def _raw(reply: str | bytes | HangUp) -> bytes | HangUp:
    return bytes.fromhex(reply) if isinstance(reply, str) else reply


class Peer(threading.Thread):
    """Reads each expected byte string in full, then sends its reply."""

    def __init__(self, master: int, pairs: Sequence[Pair]) -> None:
        super().__init__(daemon=True)
        self.master = master
        self.pairs = [(bytes.fromhex(sent), _raw(reply)) for sent, reply in pairs]
        self.wrong: str | None = None
        self.start()

    def run(self) -> None:
        for number, (expected, reply) in enumerate(self.pairs):
            got = b""
            while len(got) < len(expected):
                if not select.select([self.master], [], [], PATIENCE_S)[0]:
                    break
                got += os.read(self.master, len(expected) - len(got))
            if got != expected:
                self.wrong = f"exchange {number}: expected {expected.hex(' ')}, got {got.hex(' ')}"
                return
            if isinstance(reply, bytes):
                os.write(self.master, reply)
            else:
                # The number stays taken, so that nobody else's file gets it; the terminal's own end is gone.
                null = os.open(os.devnull, os.O_RDWR)
                os.dup2(null, self.master)
                os.close(null)
                reply.done.set()

    def finish(self) -> None:
        self.join(2 * PATIENCE_S)
        assert not self.is_alive()
        assert self.wrong is None, self.wrong
        rest = os.read(self.master, 4096) if select.select([self.master], [], [], 0)[0] else b""
        assert rest == b"", f"sent beyond what was expected: {rest.hex(' ')}"


@contextmanager
def line() -> Iterator[tuple[int, str]]:
    """The master's descriptor of a pseudo-terminal, and the slave's path."""
    master, slave = pty.openpty()
    try:
        yield master, os.ttyname(slave)
    finally:
        os.close(slave)
        os.close(master)


@contextmanager
def expected_exchange(
    monkeypatch: pytest.MonkeyPatch, pairs: Sequence[Pair], **changes: Any
) -> Iterator[SerialDacDriver]:
    """A driver, not open, on a line where exactly these bytes are sent, close included, and answered."""
    monkeypatch.setattr("random.randrange", lambda _: 0x1233)
    with line() as (master, path):
        peer = Peer(master, pairs)
        driver = SerialDacDriver(config(path, **changes))
        try:
            yield driver
        finally:
            driver.close()
        peer.finish()
