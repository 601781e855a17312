"""A hand lets go of the enable and holds it again: by the device's own log the current ends, and nothing begins by itself.

The hand waits for what it sees, never for a time: SIGUSR1 to the device moves it.
"""

from __future__ import annotations

import signal
import time
from pathlib import Path
from typing import Any

import pytest

from hapticd.client import RequestRefused
from hapticd.commission.limits import LOST
from hapticd.commission.step import DisturbedError
from hapticd.config import apply_settings
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.device import Device
from hapticd.hil.matrix import with_current, with_enable
from tests.drivers.canopen.test_both_drives import SWITCH
from tests.hil.test_hil import TRANSPORTS, config
from tests.hil.test_other_drive import OtherDrive
from tests.polling import wait_until

SERIAL, CAN = "serial board on a pty", "CAN frames over a Unix socket"
DEVICES: dict[str, tuple[str, type[Device], dict[str, Any]]] = {
    "serial board": (SERIAL, Device, {}),
    "our drive": (CAN, Device, {}),
    "drive of other hands": (CAN, OtherDrive, {}),
    "drive of other hands, with STO": (CAN, OtherDrive, {"sto": True}),
}
TICKS, ATTEMPTS = 100, 5


@pytest.mark.realtime
@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize("name", DEVICES)
def test_released_the_current_is_zero_and_nothing_begins_by_itself(name: str, tmp_path: Path) -> None:
    for attempt in range(ATTEMPTS):
        try:
            play(*DEVICES[name], tmp_path / str(attempt))
        except DisturbedError as disturbed:
            reason = str(disturbed)
        else:
            return
    pytest.skip(f"this machine is too busy, {ATTEMPTS} times: {reason}")


def play(transport: str, kind: type[Device], start: dict[str, Any], folder: Path) -> None:
    """Once.

    Raises:
        DisturbedError: this machine ended the motion before the hand did, or let it not begin.
    """
    rig = with_enable(with_current(config(TRANSPORTS[transport], rate_hz=100.0)))
    rig = apply_settings(rig, {"safety.missed_exchanges": 50, "safety.guard": "off"}, source="a busy machine")
    device = kind(rig, folder, script={"start": start, "faults": SWITCH})
    with device:
        device.wait_ready()
        with DaemonProcess(rig, folder, device.options) as daemon:
            daemon.wait_ready()
            client = daemon.client
            run(daemon)
            wait_until(lambda: flows(device) or client.status()["state"] == "fault", "a current")
            device.signal(signal.SIGUSR1)
            status = daemon.wait_state("fault")
            if status["fault"]["code"] in LOST:
                raise DisturbedError(status["fault"]["cause"])
            assert (status["fault"]["code"], status["enable"]["held"]) == ("enable_released", False)
            wait_until(lambda: not flows(device), "zero current")
            held_ns = time.monotonic_ns()
            device.signal(signal.SIGUSR1)
            wait_until(lambda: client.status()["enable"]["held"], "the hand")
            with pytest.raises(RequestRefused, match="enable_released"):
                client.start()
            client.clear()
            ticks = client.status()["timing"]["ticks"]
            wait_until(lambda: client.status()["timing"]["ticks"] > ticks + TICKS, "ticks without a start")
            again_ns = time.monotonic_ns()
            run(daemon)
    log = device.read_log()
    released_ns = log.injected_ns()
    assert released_ns is not None
    zero_ns = log.until(again_ns).zero_current_after(released_ns)
    assert zero_ns is not None
    assert zero_ns <= held_ns


def run(daemon: DaemonProcess) -> None:
    """Render."""
    try:
        daemon.client.start()
    except RequestRefused as refusal:
        if refusal.code in ("expired", "stopped"):
            raise DisturbedError(str(refusal)) from refusal
        raise
    fault = daemon.wait_state("running", "fault")["fault"]
    if fault and fault["code"] in LOST:
        raise DisturbedError(fault["cause"])
    assert fault is None


def flows(device: Device) -> bool:
    """Whether current flows in the motor, as far as the device's log was read."""
    return bool(device.read_log().applied_A[-1] != 0.0)
