"""A drive that is a script: every frame of an exchange on one line, ``> 080#`` from the host, ``< 181#…`` from the drive."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable
from types import TracebackType

import numpy as np

from drivers import new_exchange
from drivers.canopen import cyclic
from drivers.canopen import layout as w
from drivers.canopen.reasons import explain
from drivers.interface import X_CURRENT, X_ENABLE
from tests.polling import PATIENCE_S

PERIOD_NS = 1e9 * PATIENCE_S
"""Four fifths of it are the time-out of a reply: long, so that a busy machine does not fail a test."""


def frame(text: str) -> bytes:
    """``struct can_frame`` of candump's notation: 181#0A0B, 701#R; 8 digits are an extended identifier."""
    identifier, _, data = text.partition("#")
    number = int(identifier, 16) | (0x80000000 if len(identifier) == 8 and not identifier.startswith("2") else 0)
    if data == "R":
        return struct.pack("<IB3x8s", number | 0x40000000, 0, b"")
    payload = bytes.fromhex(data)
    return struct.pack("<IB3x8s", number, len(payload), payload)


def text(raw: bytes) -> str:
    """candump's notation of a ``struct can_frame``."""
    identifier, length, data = struct.unpack("<IB3x8s", raw)
    return f"{identifier & 0x7FF:03X}#" + ("R" if identifier & 0x40000000 else data[:length].hex().upper())


class Wire:
    """The exchange's memory, set up for node 1 with 0.002 A a step, and the drive's end of its socket."""

    def __init__(self, guard_ms: int = 0, *, read_back: bool = False) -> None:
        ours, self.drive = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.ours = ours
        self.drive.settimeout(PATIENCE_S)
        self.s = np.zeros(w.WORDS, np.int64)
        self.s[w.DESCRIPTOR], self.s[w.NODE] = ours.fileno(), 1
        self.s[w.GUARD_NS] = guard_ms * 1_000_000 if guard_ms else 2**60
        self.s[w.GUARD_LOW], self.s[w.GUARD_ANSWERED], self.s[w.GUARD_TOGGLE] = 0x701 | w.REMOTE, 1, -1
        self.s.view(np.float64)[w.COMMAND_PER_AMPERE] = 500.0
        self.s.view(np.float64)[w.AMPERE_PER_ACTUAL] = 0.01
        self.s[w.READ_BACK], self.s.view(np.float64)[w.AMPERE_PER_DEMAND] = int(read_back), 0.002
        self.x = new_exchange()
        self.xf = self.x.view(np.float64)

    def read(self, *script: str, period_ns: float = PERIOD_NS) -> int:
        """One read against the script."""
        return self._run(script, lambda: int(cyclic.read(self.s, self.x, period_ns)))

    def write(self, current: float, enable: int, *script: str, period_ns: float = PERIOD_NS) -> int:
        """One write against the script."""
        self.xf[X_CURRENT], self.x[X_ENABLE] = current, enable
        return self._run(script, lambda: int(cyclic.write(self.s, self.x, period_ns)))

    def _run(self, script: tuple[str, ...], call: Callable[[], int]) -> int:
        """What the script says first has arrived before the call; the rest is played beside it."""
        problems: list[str] = []
        lines = list(script)
        while lines and lines[0].startswith("<"):
            self.drive.send(frame(lines.pop(0)[2:]))

        def play() -> None:
            for line in lines:
                if line.startswith("<"):
                    self.drive.send(frame(line[2:]))
                    continue
                try:
                    got = text(self.drive.recv(64))
                except TimeoutError:
                    got = "nothing"
                if got != line[2:]:
                    problems.append(f"expected {line[2:]}, got {got}")
                    return

        thread = threading.Thread(target=play)
        thread.start()
        result = call()
        thread.join()
        assert not problems, problems
        return result

    def nothing_sent(self) -> bool:
        """Whether the drive's end has no further frame waiting."""
        self.drive.setblocking(False)
        try:
            return not self.drive.recv(64)
        except BlockingIOError:
            return True
        finally:
            self.drive.settimeout(PATIENCE_S)

    @property
    def why(self) -> str | None:
        return explain(self.s)

    def __enter__(self) -> Wire:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: object, trace: TracebackType | None) -> None:
        self.ours.close()
        self.drive.close()
