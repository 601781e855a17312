"""The enable that a person holds, on the serial line: what is asked with it; what says nothing of it says released."""

from __future__ import annotations

import struct

import pytest

from drivers import DriverError
from drivers.interface import OK, STATUS_ENABLED, STATUS_HELD, X_STATUS
from drivers.serial_dac import budget
from drivers.serial_dac.options import more_bytes
from tests.drivers.serial.expected_exchange import OPENING, Loop, Pair, config, expected_exchange, reply
from tests.drivers.serial.reference import framed

HELD = {"safety": {"enable": True}}


def asked(seq: int) -> str:
    return framed(bytes([0x05, seq])).hex()


def command(seq: int, code: int, flags: int) -> str:
    return framed(struct.pack("<BBHB", 0x04, seq, code, flags)).hex()


def inputs(seq: int, held: int, status: int = 0, command_seq: int = 1) -> bytes:
    return framed(struct.pack("<BBIIBBB", 0x84, seq, 0, 1000 * seq, status, command_seq, held))


def closing(seq: int) -> list[Pair]:
    return [("00" + command(seq, 1 << 13, 0), ""), (command(seq, 1 << 13, 0), "")]


def test_inputs_byte_for_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs: list[Pair] = [
        *OPENING[:3],
        (asked(1), inputs(1, 0)),
        (asked(2), inputs(2, 1)),
        (command(2, 1 << 13, 3), ""),  # on, while it is held
        (asked(3), inputs(3, 1, status=1, command_seq=2)),
        (command(3, (1 << 13) + 100, 3), ""),
        (asked(4), inputs(4, 0, command_seq=3)),  # released, and off by itself
        (command(4, 1 << 13, 3), ""),
        (asked(5), reply(5, 0, 1, command_seq=4)),  # a reply without inputs
        (command(5, 1 << 13, 0), ""),
        *closing(5),
    ]
    with expected_exchange(monkeypatch, pairs, **HELD) as driver:
        driver.open()
        loop = Loop(driver)
        for status, code, enable in (
            (STATUS_HELD, 0, 1),
            (STATUS_HELD | STATUS_ENABLED, 100, 1),
            (0, 0, 1),
            (STATUS_ENABLED, 0, 0),
        ):
            assert loop.read() == OK
            assert loop.x[X_STATUS] == status
            assert loop.write(code, enable) == OK


def test_firmware_that_knows_no_inputs_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    tries: list[Pair] = [
        pair for seq in (1, 2, 3) for pair in ((command(seq, 1 << 13, 0), ""), (asked(seq), reply(seq, 0)))
    ]
    said = r"safety.enable = true: the board does not reply to SAMPLE_INPUTS; its firmware 1.2 has no enable input"
    with (
        expected_exchange(monkeypatch, [*OPENING[:2], *tries, *closing(0)], **HELD) as driver,
        pytest.raises(DriverError, match=said),
    ):
        driver.open()


def test_a_longer_reply_takes_its_time() -> None:
    asks = config(servo={"rate_hz": 100.0}, **HELD)
    assert more_bytes(asks) == len(inputs(0, 1)) - budget.REPLY_BYTES == 1
    assert budget.default_latency_s(115_200, 1) - budget.default_latency_s(115_200) == pytest.approx(10 / 115_200)
    assert budget.rate_refusal(297.0, 115_200, 20, None) is None
    assert "an exchange of 32 bytes" in (budget.rate_refusal(297.0, 115_200, 20, None, 1) or "")
