"""The bytes of a session, one line an exchange, and what the loop is told of them."""

import math
import os
import time
import tty

import pytest

from drivers.interface import (
    DEVICE_FAULT,
    LOST,
    MISSED,
    OK,
    X_COUNTS,
    X_CURRENT_MEASURED,
    X_DEVICE_CODE,
    X_STATUS,
)
from drivers.serial_dac import SerialDacDriver, exchange
from drivers.serial_dac.exchange import unwrapped
from drivers.serial_dac.state import S_DAC_BITS, new_state
from tests.drivers.serial import reference
from tests.drivers.serial.expected_exchange import (
    CLOSING_1,
    CLOSING_2,
    COMMAND_2,
    IMPATIENT_S,
    OPENING,
    SAMPLE_2,
    HangUp,
    Loop,
    Pair,
    config,
    expected_exchange,
    line,
    line_errors,
    reply,
)
from tests.polling import PATIENCE_S, wait_until

ON = 1


def test_a_session_byte_for_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs: list[Pair] = [
        *OPENING,
        ("05 03 02 1e 68 00", "04 83 02 66 01 01 03 d0 07 01 01 04 01 9d 60 00"),  # SAMPLE 2 → count 102, off
        ("03 04 02 05 20 01 a5 63 00", ""),  # COMMAND 2: mid-scale, enable
        ("05 03 03 3f 78 00", "04 83 03 67 01 01 03 b8 0b 01 05 01 02 b2 0d 00"),  # SAMPLE 3 → count 103, on
        ("08 04 03 ab 22 01 1e 3e 00", ""),  # COMMAND 3: code 8192 + 683
        ("05 03 04 d8 08 00", "04 83 04 68 01 01 03 a0 0f 01 05 01 03 5f fc 00"),  # SAMPLE 4 → count 104, on
        ("03 04 04 02 20 03 1d 54 00", ""),  # COMMAND 4: mid-scale, disable, though a code was given
        ("00 03 04 04 02 20 03 1d 54 00", ""),
        ("03 04 04 02 20 03 1d 54 00", ""),
    ]
    with expected_exchange(monkeypatch, pairs) as driver:
        driver.open()
        loop = Loop(driver)
        assert (loop.read(), loop.x[X_COUNTS], loop.x[X_STATUS]) == (OK, 102, 0)
        assert math.isnan(loop.floats[X_CURRENT_MEASURED])
        assert loop.write(0, 1) == OK
        assert (loop.read(), loop.x[X_COUNTS], loop.x[X_STATUS]) == (OK, 103, 1)
        assert loop.write(683, 1) == OK
        assert (loop.read(), loop.x[X_COUNTS]) == (OK, 104)
        assert loop.write(683, 0) == OK
    assert line_errors(driver) == (0, 0)


def test_garbage_before_a_reply_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    noise = bytes(range(1, 200)) + b"\0"
    pairs = [*OPENING, (SAMPLE_2, noise + reply(2, 7)), (COMMAND_2, ""), *CLOSING_2]
    with expected_exchange(monkeypatch, pairs) as driver:
        driver.open()
        loop = Loop(driver)
        assert (loop.read(), loop.x[X_COUNTS]) == (OK, 7)
        assert loop.write(683, 1) == OK
    assert line_errors(driver) == (0, 1)


@pytest.mark.parametrize(
    ("first", "second", "errors"),
    [
        (b"", b"", (0, 0)),  # silence
        (reply(1, 5), b"", (1, 0)),  # a stale reply is no reply
        (reply(2, 7)[:-3] + b"\0", b"", (0, 1)),  # a damaged one neither
        (reply(2, 7)[:6], reply(2, 7)[6:], (1, 0)),  # the second half comes a tick late
    ],
)
def test_an_exchange_without_its_reply_is_missed_and_commanded(
    monkeypatch: pytest.MonkeyPatch, first: bytes, second: bytes, errors: tuple[int, int]
) -> None:
    pairs: list[Pair] = [*OPENING, (SAMPLE_2, first), (COMMAND_2, second), ("05 03 03 3f 78 00", reply(3, 8, ON, 2))]
    pairs += [
        ("03 04 03 02 20 03 30 05 00", ""),
        ("00 03 04 03 02 20 03 30 05 00", ""),
        ("03 04 03 02 20 03 30 05 00", ""),
    ]
    with expected_exchange(monkeypatch, pairs) as driver:
        driver.open()
        loop = Loop(driver)
        loop.x[X_COUNTS] = 100
        assert (loop.read(IMPATIENT_S), loop.x[X_COUNTS]) == (MISSED, 100)
        assert loop.write(683, 1) == OK
        assert (loop.read(), loop.x[X_COUNTS]) == (OK, 8)
        assert loop.write(0, 0) == OK
    assert line_errors(driver) == errors


def test_a_command_that_the_board_does_not_confirm_is_a_missed_exchange(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs: list[Pair] = [*OPENING, (SAMPLE_2, reply(2, 7)), (COMMAND_2, ""), ("05 03 03 3f 78 00", reply(3, 8, 32, 1))]
    pairs += [
        ("03 04 03 02 20 03 30 05 00", ""),
        ("05 03 04 d8 08 00", reply(4, 9, 0, 3)),
        ("03 04 04 02 20 03 1d 54 00", ""),
    ]
    pairs += [("00 03 04 04 02 20 03 1d 54 00", ""), ("03 04 04 02 20 03 1d 54 00", "")]
    with expected_exchange(monkeypatch, pairs) as driver:
        driver.open()
        loop = Loop(driver)
        assert (loop.read(), loop.write(683, 1)) == (OK, OK)
        assert (loop.read(), loop.x[X_COUNTS]) == (OK, 8)  # the sample is good
        assert loop.write(0, 0) == MISSED  # the command before was not
        assert (loop.read(), loop.write(0, 0)) == (OK, OK)


@pytest.mark.parametrize("status", [2, 4, 8, 64, 1 | 8, 2 | 64])
def test_a_fault_of_the_board_is_a_device_fault_with_its_status(monkeypatch: pytest.MonkeyPatch, status: int) -> None:
    with expected_exchange(monkeypatch, [*OPENING, (SAMPLE_2, reply(2, 7, status)), *CLOSING_2]) as driver:
        driver.open()
        loop = Loop(driver)
        assert (loop.read(), loop.x[X_DEVICE_CODE], loop.x[X_STATUS]) == (DEVICE_FAULT, status, status & 1)


@pytest.mark.parametrize("status", [128, 128 | 32, 128 | 4])
def test_a_board_that_has_restarted_ends_the_session(monkeypatch: pytest.MonkeyPatch, status: int) -> None:
    with expected_exchange(monkeypatch, [*OPENING, (SAMPLE_2, reply(2, 0, status)), *CLOSING_2]) as driver:
        driver.open()
        loop = Loop(driver)
        before = loop.x[X_COUNTS]
        assert (loop.read(), loop.x[X_COUNTS]) == (LOST, before)  # its count is not ours any more
        assert (loop.write(100, 1), loop.read()) == (LOST, LOST)
        assert driver.error is not None
        assert "has restarted: it lost its settings and its encoder count" in driver.error
        driver.close()
        assert "has restarted" in driver.error


@pytest.mark.parametrize("status", [0, 1, 16, 32, 1 | 16 | 32])
def test_a_remark_of_the_board_is_no_fault(monkeypatch: pytest.MonkeyPatch, status: int) -> None:
    with expected_exchange(monkeypatch, [*OPENING, (SAMPLE_2, reply(2, 7, status)), *CLOSING_2]) as driver:
        driver.open()
        assert Loop(driver).read() == OK


@pytest.mark.parametrize(
    ("code", "enable", "sent"),
    [
        (8191, 1, "08 04 01 ff 3f 01 57 24 00"),
        (-8192, 1, "03 04 01 01 04 01 9f fe 00"),
        (99999, 1, "08 04 01 ff 3f 01 57 24 00"),  # beyond the converter: clamped, never wrapped
        (-99999, 1, "03 04 01 01 04 01 9f fe 00"),
        (0, 1, "03 04 01 05 20 01 79 f8 00"),
        (0, 0, "03 04 01 02 20 03 58 e8 00"),
        (8191, 0, "03 04 01 02 20 03 58 e8 00"),
        (8191, 7, "03 04 01 02 20 03 58 e8 00"),  # enable is 1 and nothing else
    ],
)
def test_codes_in_offset_binary(monkeypatch: pytest.MonkeyPatch, code: int, enable: int, sent: str) -> None:
    with expected_exchange(monkeypatch, [*OPENING, (sent, ""), *CLOSING_1]) as driver:
        driver.open()
        assert Loop(driver).write(code, enable) == OK


def test_the_counter_wraps_and_the_position_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    opening: list[Pair] = [*OPENING[:3], (OPENING[3][0], reply(1, -3))]
    pairs: list[Pair] = [*opening, (SAMPLE_2, reply(2, 4)), ("05 03 03 3f 78 00", reply(3, 0x7FFFFFFF))]
    pairs += [
        ("05 03 04 d8 08 00", reply(4, 0x80000010)),
        ("00 03 04 04 02 20 03 1d 54 00", ""),
        ("03 04 04 02 20 03 1d 54 00", ""),
    ]
    with expected_exchange(monkeypatch, pairs) as driver:
        driver.open()
        loop = Loop(driver)
        found = [(loop.read(), int(loop.x[X_COUNTS])) for _ in range(3)]
        assert found == [(OK, 4), (OK, 0x7FFFFFFF), (OK, 0x80000010)]


@pytest.mark.parametrize("bits", [16, 20, 24, 32])
def test_unwrapping_follows_any_walk_that_is_slow_enough(bits: int) -> None:
    half = 1 << (bits - 1)
    truth = position = 0
    for step in [half - 1] * 5 + [-half] * 9 + [1, -1, 0, 12345]:
        truth += step
        # The bits above the counter's width are noise.
        position = unwrapped(position, (truth & (2 * half - 1)) | (0xAAAA << bits), bits)
        assert position == truth


def test_a_hangup_is_a_lost_device_at_once_and_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    gone = HangUp()
    with expected_exchange(monkeypatch, [*OPENING, (SAMPLE_2, reply(2, 7)), (COMMAND_2, gone)]) as driver:
        driver.open()
        loop = Loop(driver)
        assert (loop.read(), loop.write(683, 1)) == (OK, OK)
        assert gone.done.wait(PATIENCE_S)
        began = time.monotonic()
        assert [loop.read(), loop.write(0, 0), loop.read(), loop.write(5, 1)] == [LOST] * 4
        assert time.monotonic() - began < 0.5 * PATIENCE_S  # a read that waited would have taken its whole period


def test_a_hangup_while_the_reply_is_awaited(monkeypatch: pytest.MonkeyPatch) -> None:
    with expected_exchange(monkeypatch, [*OPENING, (SAMPLE_2, HangUp())]) as driver:
        driver.open()
        loop = Loop(driver)
        assert [loop.read(), loop.write(683, 1)] == [LOST, LOST]


def test_nothing_is_sent_once_the_driver_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    with expected_exchange(monkeypatch, [*OPENING, *CLOSING_1]) as driver:
        driver.open()
        loop = Loop(driver)
        driver.close()
        assert [loop.read(), loop.write(683, 1)] == [LOST, LOST]
        driver.close()


def test_a_line_that_never_falls_silent_does_not_hold_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    with expected_exchange(monkeypatch, [*OPENING, (SAMPLE_2, b"x" * 3000), *CLOSING_2]) as driver:
        driver.open()
        loop = Loop(driver)
        began = time.monotonic()
        assert loop.read(IMPATIENT_S) == MISSED
        assert time.monotonic() - began < PATIENCE_S
    assert line_errors(driver) == (0, 0)


def test_a_full_line_is_a_missed_exchange_and_the_next_frame_is_set_apart() -> None:
    with line() as (master, path):
        open_port = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        driver = SerialDacDriver(config(path))
        words = new_state(open_port, 921_600, 0.01)
        words[S_DAC_BITS] = 14
        driver.read_address, driver.write_address = exchange.read.address, exchange.write.address
        driver.state_address = words.ctypes.data
        tty.setraw(open_port)
        loop = Loop(driver)
        results = [loop.write(0, 1) for _ in range(8192)]
        assert results[0] == OK
        assert MISSED in results
        sent = b""
        # The kernel hands a terminal's bytes on when it comes to it; the last frame of the first flood is cut off.
        while len([payload for payload in reference.payloads(sent) if payload[0] == 4]) < results.count(OK):
            sent += os.read(master, 4096)
        wait_until(lambda: loop.write(0, 0) == OK, "room for a frame")
        while reference.payloads(sent)[-1] != bytes.fromhex("04 00 00 20 00"):
            sent += os.read(master, 4096)
        os.close(open_port)
    frames = [payload for payload in reference.payloads(sent) if payload[0] == 4]
    assert len(frames) == results.count(OK) + 1
    assert frames[-1] == bytes.fromhex("04 00 00 20 00")
