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


NO_WATCHDOG = SOURCE / "build" / "mps2-an385" / "no-watchdog.elf"
"""The board mps2-an385 with a watchdog that never starts."""


@functools.cache
def build(board: str, image: Path | None = None) -> str | None:
    """Make a board's binary, or another one for that board; why it cannot be, or None."""
    target = board if image is None else str(image.relative_to(SOURCE))
    with one_at_a_time():
        for command in ([str(FIRMWARE / "install.sh"), board], ["make", "-C", str(SOURCE), target]):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                return f"{' '.join(command)}: {(done.stderr.strip() or done.stdout.strip())[-2000:]}"
    return None


def require(board: str, image: Path | None = None) -> None:
    """Skip the test where an emulator is missing and cannot be installed; fail it where the firmware does not build."""
    why = build(board, image)
    if why and board in OPTIONAL and "install.sh" in why.split(":")[0]:
        pytest.skip(f"no emulator for {board}: {why}")
    assert why is None, why
