"""A beginning that goes wrong: each way has its own words, and every one leaves the board at zero and off."""

import pytest

from drivers import DriverError
from drivers.serial_dac import session
from tests.drivers.serial.expected_exchange import (
    CLOSING_1,
    HELLO,
    OPENING,
    HangUp,
    Pair,
    expected_exchange,
    hello_reply,
    reply,
)
from tests.drivers.serial.reference import framed

CLOSING_0: list[Pair] = [("00 02 04 01 02 20 03 ec 9e 00", ""), ("02 04 01 02 20 03 ec 9e 00", "")]
CLOSING_0_OF_12_BITS: list[Pair] = [("00 02 04 01 02 08 03 a3 11 00", ""), ("02 04 01 02 08 03 a3 11 00", "")]
CONFIGURE, OFF_1, SAMPLE_1 = (sent for sent, _ in OPENING[1:])
OFF_AND_SAMPLE = [(OFF_1, ""), (SAMPLE_1, "")]


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "HELLO_S", 0.4)
    monkeypatch.setattr(session, "HELLO_EVERY_S", 0.4)
    monkeypatch.setattr(session, "REPLY_S", 0.4)
    monkeypatch.setattr(session, "ATTEMPTS", 1)


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        ([(HELLO, "")], "no reply from a board within 0.4 s (nothing was received; is the board powered"),
        (
            [(HELLO, b"boot ok\r\n\0")],
            "10 bytes were received, with 1 bad frames and no reply; is driver.baud that of the board",
        ),
        ([(HELLO, hello_reply(nonce=0x4321))], "within 0.4 s (24 bytes were received, with 0 bad frames"),
        ([(HELLO, hello_reply(version=2))], "the board has version 2 of the protocol, this driver version 1"),
        (
            [(HELLO, framed(bytes.fromhex("81 03 34 12")))],
            "the board has version 3 of the protocol, this driver version 1",
        ),
        ([(HELLO, framed(bytes.fromhex("81 01 34 12 0e")))], "the board's HELLO reply has 5 bytes"),
        ([(HELLO, hello_reply(bits=20))], "is invalid: dac_bits = 20, not in 8 … 16"),
        (
            [(HELLO, hello_reply(scale=0, counter=8))],
            "is invalid: full scale = 0 µA; counter_bits = 8, not in 16 … 32",
        ),
        ([(HELLO, hello_reply(least=9, most=8))], "is invalid: watchdog range = 9 … 8 ms"),
        (
            [(HELLO, hello_reply(bits=12)), *CLOSING_0_OF_12_BITS],
            "amplifier.dac_bits = 14 bits, but the board's DAC has 12 bits",
        ),
        (
            [(HELLO, hello_reply(scale=5_000_000)), *CLOSING_0],
            "amplifier.dac_full_scale = 6 A, but the board's full scale is 5 A",
        ),
        (
            [(HELLO, hello_reply(most=100)), *CLOSING_0],
            "driver.watchdog_ms = 200 ms: the board allows 5 to 100 ms",
        ),
        ([*OPENING[:1], (CONFIGURE, ""), *CLOSING_0], "the board does not reply to CONFIGURE"),
        (
            [*OPENING[:1], (CONFIGURE, framed(b"\x82\0\0")), *CLOSING_0],
            "driver.watchdog_ms = 200 ms: the board refused it",
        ),
        ([*OPENING[:1], (CONFIGURE, framed(b"\x82\x14\0")), *CLOSING_0], "200 ms: the board has set 20 ms"),
        ([*OPENING[:2], *OFF_AND_SAMPLE, *CLOSING_0], "the board does not reply to SAMPLE"),
        (
            [*OPENING[:3], (SAMPLE_1, reply(1, 0, status=1)), *CLOSING_0],
            "the board does not confirm zero current and disable (status 0x01)",
        ),
        (
            [*OPENING[:3], (SAMPLE_1, reply(1, 0, status=32, command_seq=0)), *CLOSING_0],
            "the board does not confirm zero current and disable (status 0x20)",
        ),
        ([(HELLO, HangUp())], "the port is lost"),
        ([*OPENING[:1], (CONFIGURE, HangUp())], "the port is lost"),
    ],
)
def test_a_beginning_that_fails(monkeypatch: pytest.MonkeyPatch, pairs: list[Pair], said: str) -> None:
    with expected_exchange(monkeypatch, pairs) as driver:
        with pytest.raises(DriverError) as caught:
            driver.open()
        assert said in str(caught.value)
        assert str(caught.value).startswith("/dev/pts/")
        assert driver.read_address == 0


def test_a_board_that_first_has_to_boot_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "HELLO_S", 30.0)
    second = ("07 01 01 35 12 57 0d 00", hello_reply(nonce=0x1235))  # lost with the text before it
    third = ("07 01 01 36 12 04 58 00", hello_reply(nonce=0x1236))
    with expected_exchange(monkeypatch, [(HELLO, b"boot\r\n"), second, third, *OPENING[1:], *CLOSING_1]) as driver:
        driver.open()


def test_a_latched_fault_of_the_board_does_not_keep_it_from_being_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = [*OPENING[:3], (SAMPLE_1, reply(1, 0, status=64)), *CLOSING_1]
    with expected_exchange(monkeypatch, pairs) as driver:
        driver.open()
        assert driver.read_address != 0


def test_the_banner_names_port_baud_firmware_and_capabilities(monkeypatch: pytest.MonkeyPatch) -> None:
    with expected_exchange(monkeypatch, [*OPENING, *CLOSING_1]) as driver:
        assert driver.describe().endswith("at 921600 baud, not open")
        driver.open()
        assert driver.describe().startswith("serial DAC board on /dev/pts/")
        assert driver.describe().endswith(
            " at 921600 baud, firmware 1.2, serial number 48879: 14 bits over ± 6 A, 32-bit counter, watchdog 200 ms"
        )
