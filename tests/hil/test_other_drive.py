"""The fault matrix on a drive of other hands: every cell as with ours.

The drive has no deadline for RPDO 1 (0x1400:5), as Copley's has none: lost commands end by the demand that it sends back.
What it does once an enable that opens Safe Torque Off is released stands in ``test_enable.py``; ours has the input alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hapticd.hil import matrix
from hapticd.hil.device import Device
from hapticd.hil.errors import HilError
from hapticd.hil.injections import CANOPEN, INJECTIONS, Injection
from tests.hil.test_hil import TRANSPORTS, config

OURS, OTHER = "sim_hw", "tests.drivers.other_drive"
SAMPLE = ("drop_commands", "leave_operation_enabled", "emcy", "enable_released", "sigkill")
"""The rest with ``-m attack``."""
STALL_MS = 300
"""How long the daemon stands still; the drive's watchdog must have acted by then."""


class OtherDrive(Device):
    """Its process takes the same command line."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.command = [OTHER if word == OURS else word for word in self.command]


@pytest.mark.realtime
@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize(
    "injection",
    [
        pytest.param(one, id=one.name, marks=() if one.name in SAMPLE else pytest.mark.attack)
        for one in INJECTIONS
        if CANOPEN in one.devices and not one.clock_jump
    ],
)
def test_every_cell_is_as_with_ours(injection: Injection, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matrix, "Device", OtherDrive)
    driver = TRANSPORTS["CAN frames over a Unix socket"]
    if injection.name == "stall":
        driver = {**driver, "watchdog_ms": STALL_MS / 2}
    rig = config(driver)
    try:
        row = matrix.run_injection(rig, injection, tmp_path)
    except HilError as error:
        if "this machine is too busy" not in str(error):
            raise
        pytest.skip(str(error))
    if injection.refused:
        assert row.met, row.problems
    elif injection.codes:
        assert row.code in injection.codes
        assert row.zero_after_s is not None
        assert row.zero_after_s < 0.7
    else:  # the daemon was ended, or it goes on
        assert not [problem for problem in row.problems if "zero current after" not in problem]
