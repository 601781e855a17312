"""Every statement of the protocol page is proved by a test against every device, or said here not to be."""

from pathlib import Path

import pytest

from tests.firmware import test_driver, test_protocol
from tests.firmware.citations import PAGE, plain, statements

ROOT = Path(__file__).resolve().parents[2]

ELSEWHERE = {
    "What a board with an encoder counter": "the page's subject",
    "Host: drivers/serial_dac/": "a place",
    "Reference firmware: firmware/serial_dac/": "a place",
    "The words must, should and may": "a definition",
    "The host repeats HELLO with new nonces": "tests/drivers/serial/test_session.py",
    "Replies are awaited for 250 ms": "tests/drivers/serial/test_session.py",
    "Until the user starts, every COMMAND": "tests/service/test_daemon.py",
    "Stop, or a fault on the host's side": "tests/servo/test_trips.py",
    "UNCONFIGURED ends the session": "tests/service/test_reconnect.py",
    "more than safety.missed_exchanges": "tests/servo/test_trips.py",
    "The board should start its reply within 50 µs": "a time on silicon, which no emulation shows",
    "Both are part of the sample-to-current latency": "drivers/serial_dac/budget.py",
    "USB adapters add their own time": "tests/drivers/serial/test_port.py",
}
"""Statements that no device of the suite can show, with the place that holds them."""


def cited() -> list[str]:
    return [
        quote
        for module in (test_protocol, test_driver)
        for name, function in vars(module).items()
        if name.startswith("test_")
        for mark in getattr(function, "pytestmark", [])
        if mark.name == "cites"
        for quote in mark.args
    ]


def found(quote: str, lines: list[str]) -> list[str]:
    return [line for line in lines if plain(quote) in line or quote.strip() in line]


def test_every_statement_is_cited() -> None:
    lines = statements(PAGE.read_text())
    proved = {line for quote in [*cited(), *ELSEWHERE] for line in found(quote, lines)}
    assert [line for line in lines if line not in proved] == []


@pytest.mark.parametrize("quote", sorted({*cited(), *ELSEWHERE}))
def test_a_citation_is_on_the_page(quote: str) -> None:
    assert found(quote, statements(PAGE.read_text()))


def test_the_places_exist() -> None:
    for place in ELSEWHERE.values():
        if "/" in place:
            assert (ROOT / place).exists(), place
