"""The exchange through python-can: the same frames and verdicts as the compiled one, on a bus without a descriptor."""

from __future__ import annotations

from collections import deque

import can
import numpy as np
import pytest

from drivers.canopen import layout as w
from drivers.canopen.callback import CallbackExchange
from drivers.canopen.reasons import explain
from drivers.interface import (
    DEVICE_FAULT,
    ERROR,
    LOST,
    MISSED,
    OK,
    X_COUNTS,
    X_CURRENT,
    X_DEVICE_CODE,
    X_ENABLE,
    X_PERIOD_NS,
    new_exchange,
)

ENABLED = can.Message(arbitration_id=0x181, is_extended_id=False, data=bytes.fromhex("3702D204000000FE"))


class Line(can.BusABC):
    """A bus that answers SYNC with what ``answers`` holds, and may give every sent frame back."""

    def __init__(self, *, echoes: bool = False) -> None:
        self.echoes, self.broken = echoes, False
        self.answers: list[can.Message] = []
        self.sent: list[can.Message] = []
        self.waiting: deque[can.Message] = deque()
        super().__init__(channel="line")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.broken:
            raise can.CanOperationError("unplugged", 5)
        self.sent.append(msg)
        if self.echoes:
            self.waiting.append(msg)
        if msg.arbitration_id == w.SYNC:
            self.waiting.extend(self.answers)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return (self.waiting.popleft() if self.waiting else None), True


class Bench:
    def __init__(self, *, echoes: bool = False, guard_ms: int = 0) -> None:
        self.line = Line(echoes=echoes)
        self.s = np.zeros(w.WORDS, np.int64)
        self.s[w.NODE], self.s[w.GUARD_TOGGLE], self.s[w.GUARD_ANSWERED] = 1, -1, 1
        self.s[w.GUARD_LOW], self.s[w.GUARD_NS] = 0x701 | w.REMOTE, guard_ms * 1_000_000 if guard_ms else 2**60
        self.s.view(np.float64)[w.COMMAND_PER_AMPERE] = 500.0
        self.exchange = CallbackExchange(self.line, self.s, echoes=echoes)
        self.x = new_exchange()
        self.x.view(np.float64)[X_PERIOD_NS] = 5e8

    def tick(self, current: float, *answers: can.Message) -> tuple[int, int, list[str]]:
        self.line.answers, self.line.sent = list(answers), []
        read = self.exchange.read(self.x)
        self.x.view(np.float64)[X_CURRENT], self.x[X_ENABLE] = current, 1
        written = self.exchange.write(self.x)
        sent = [f"{m.arbitration_id:03X}#{'R' if m.is_remote_frame else m.data.hex()}" for m in self.line.sent]
        return read, written, sent


@pytest.mark.parametrize("echoes", [False, True])
def test_frames_of_a_tick(echoes: bool) -> None:
    bench = Bench(echoes=echoes, guard_ms=1)
    assert bench.tick(0.5, ENABLED) == (OK, OK, ["080#", "201#0f00fa00", "701#R"])
    assert bench.x[X_COUNTS] == 1234
    assert bench.tick(-0.5, ENABLED)[:2] == (OK, OK)


def test_another_master_is_told_from_our_own_frames() -> None:
    bench = Bench(echoes=True)
    assert bench.tick(0.5, ENABLED)[:2] == (OK, OK)
    foreign = can.Message(arbitration_id=w.SYNC, is_extended_id=False)
    assert bench.tick(0.5, foreign, ENABLED)[0] == ERROR
    assert explain(bench.s) == "another master is on the bus: it sent SYNC (0x080)"


def test_silence_fault_and_a_broken_interface() -> None:
    bench = Bench()
    assert bench.tick(0.5, ENABLED)[:2] == (OK, OK)
    assert bench.tick(0.5)[:2] == (MISSED, OK)
    assert bench.tick(0.5)[:2] == (MISSED, OK)  # listens for a late answer
    emcy = can.Message(arbitration_id=0x81, is_extended_id=False, data=bytes.fromhex("1023020000000000"))
    read, _, sent = bench.tick(0.0, emcy, ENABLED)
    assert (read, bench.x[X_DEVICE_CODE], sent[1]) == (DEVICE_FAULT, 0x2310, "201#02000000")
    bench.line.broken = True
    assert bench.tick(0.0)[:2] == (LOST, LOST)
    assert explain(bench.s) == "CAN interface: Input/output error; EMCY 0x2310 (continuous over-current)"


def test_long_frames_are_passed_over() -> None:
    bench = Bench()
    long = can.Message(arbitration_id=0x181, is_extended_id=False, is_fd=True, data=bytes(12))
    assert bench.tick(0.5, long, ENABLED)[0] == OK
    assert bench.s[w.IGNORED] == 1


def test_a_drive_that_takes_no_commands_is_stopped_here_too() -> None:
    bench = Bench()
    bench.s[w.READ_BACK], bench.s.view(np.float64)[w.AMPERE_PER_DEMAND] = 1, 0.002
    held = can.Message(arbitration_id=0x281, is_extended_id=False, data=bytes.fromhex("FA00"))
    assert bench.tick(0.5, held, ENABLED)[:2] == (OK, OK)
    assert [bench.tick(0.1, held, ENABLED)[1] for _ in range(5)] == [OK, OK, OK, OK, MISSED]
    assert bench.tick(0.1, held, ENABLED)[1:] == (LOST, ["080#", "201#02000000", "000#0201"])
