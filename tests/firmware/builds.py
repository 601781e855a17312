"""Boards as the tests need them: tools installed, firmware built, once for all processes of a test run."""

import functools
import subprocess
from pathlib import Path

import pytest

from tests.installing import one_at_a_time

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
SOURCE = FIRMWARE / "serial_dac"
OPTIONAL = ("mps2-an385", "avr-uno")
"""Their emulators may be missing where nothing can be installed; the host's compiler may not."""


@functools.cache
def build(target: str) -> str | None:
    """Make a target of the firmware's Makefile; why it cannot be, or None."""
    with one_at_a_time():
        for command in ([str(FIRMWARE / "install.sh"), target], ["make", "-C", str(SOURCE), target]):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                return f"{' '.join(command)}: {(done.stderr.strip() or done.stdout.strip())[-2000:]}"
    return None


def require(board: str) -> None:
    """Skip the test where an emulator is missing and cannot be installed; fail it where the firmware does not build."""
    why = build(board)
    if why and board in OPTIONAL and "install.sh" in why.split(":")[0]:
        pytest.skip(f"no emulator for {board}: {why}")
    assert why is None, why
