"""The fuzz command's short campaign, and that it would notice."""

import subprocess
import sys

import pytest

from drivers.serial_dac.framing import Decoder
from tests.drivers.fuzz import FuzzReport
from tests.drivers.fuzz import serial as attack
from tests.drivers.serial import reference

COUNT = 20_000


def test_twenty_thousand_inputs() -> None:
    done: list[int] = []
    report = attack.fuzz(COUNT, 1, done.append)
    assert not report.failed, report.lines()
    assert (report.inputs, done[0]) == (COUNT, 0)
    assert report.accepted > 1000
    assert report.checked > 5000
    assert min(report.rejected.values()) > 1000


def test_a_decoder_without_a_check_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    class Trusting(Decoder):
        def feed(self, data: bytes) -> list[bytes]:
            coded = [reference.unstuffed(piece) for piece in data.split(b"\0")[:-1] if piece]
            return [plain[:-2] for plain in coded if plain is not None and len(plain) > 2]

    monkeypatch.setattr(attack, "Decoder", Trusting)
    report = attack.fuzz(2000, 1, lambda _: None)
    assert report.failed
    assert report.wrong > report.wrong_limit


def test_a_decoder_that_does_not_find_back_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    class Deaf(Decoder):
        def feed(self, data: bytes) -> list[bytes]:
            return [] if self.bad_coding else super().feed(data)

    monkeypatch.setattr(attack, "Decoder", Deaf)
    report = attack.fuzz(500, 1, lambda _: None)
    assert report.failed
    assert "no good frame came through after" in report.violations[0]


def test_the_limit_is_the_odds() -> None:
    assert FuzzReport(checked=0, wrong=0, odds=2**-16).wrong_limit == 0
    assert FuzzReport(checked=65536, wrong=1, odds=2**-16).failed is False
    assert FuzzReport(checked=65536, wrong=30, odds=2**-16).failed is True
    assert FuzzReport(wrong=1).failed is True


def test_the_command() -> None:
    command = [sys.executable, "-m", "tests.drivers.fuzz", "serial", "--count", "600", "--seed", "7"]
    outcome = subprocess.run(command, capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stderr
    assert outcome.stdout.startswith("serial, seed 7, ")
    assert "600 inputs:" in outcome.stdout
    assert outcome.stdout.endswith("passed\n")
    unknown = subprocess.run([*command[:3], "morse"], capture_output=True, text=True, check=False)
    assert unknown.returncode == 2
    assert "invalid choice: 'morse'" in unknown.stderr
