"""EMCY error codes in words: every class of CiA 301 and the codes of CiA 402-2 that a torque drive's user meets."""

from __future__ import annotations

import pytest

from drivers.canopen.emcy import error_code_text


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0x0000, "no error"),
        (0x1000, "generic"),
        (0x2310, "continuous over-current"),
        (0x2341, "short circuit at the motor"),
        (0x3210, "over-voltage of the DC link"),
        (0x4310, "temperature of the motor too high"),
        (0x5113, "drive hardware: supply"),
        (0x7305, "incremental encoder 1"),
        (0x730F, "sensor"),
        (0x8110, "CAN overrun"),
        (0x8130, "life guard or heartbeat"),
        (0x8200, "protocol"),
        (0x8210, "a PDO of the wrong length"),
        (0x8220, "a PDO was longer"),
        (0x8240, "SYNC with an unexpected length"),
        (0x824F, "SYNC with an unexpected length"),
        (0x8250, "RPDO time-out"),
        (0x8260, "protocol"),
        (0x8300, "torque control"),
        (0x8331, "torque fault"),
        (0x8400, "velocity controller"),
        (0x8500, "position controller"),
        (0x8611, "following error"),
        (0x8700, "synchronisation controller"),
        (0x8B00, "monitoring"),
        (0x9000, "external error"),
        (0x90FF, "external error"),
        (0xF000, "additional functions"),
        (0xF004, "control"),
        (0xFF17, "vendor's own"),
    ],
)
def test_a_code_in_words(code: int, text: str) -> None:
    assert text in error_code_text(code)


def test_every_code_has_a_text_and_none_is_said_to_be_in_no_class_that_is_in_one() -> None:
    classes = {0x0, 0x1, 0x2, 0x3, 0x4, 0x5, 0x6, 0x7, 0x8, 0x9, 0xF}
    unknown = {code for code in range(1 << 16) if error_code_text(code).startswith("in no class")}
    assert unknown == {code for code in range(1 << 16) if code >> 12 not in classes or 0x100 <= code < 0x1000}
