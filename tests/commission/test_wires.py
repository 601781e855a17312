"""The same faults behind the wires: serial board and CAN drive, simulated in processes of their own, and the firmware."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from math import pi
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from benchmarks.commission import Nobody, no_bar
from hapticd.commission import run
from hapticd.commission.rig import Given, Rig
from hapticd.commission.step import Result
from hapticd.config import Config, apply_settings, parse_config
from hapticd.hil.cases import FIRMWARE_CONFIG, FIRMWARE_RATE_HZ, slower_rig
from hapticd.hil.device import Device
from hapticd.hil.matrix import with_enable
from hapticd.plant.hand import turning_force
from sim_hw.log import DISABLE
from tests.drivers.canopen.test_both_drives import SWITCH
from tests.firmware.builds import NO_WATCHDOG, require
from tests.hil.test_other_drive import OtherDrive

WIRES: Final[dict[str, dict[str, Any]]] = {
    "serial": {"name": "serial_dac", "port": "the board's", "baud": 921_600, "watchdog_ms": 60},
    "can": {"name": "canopen", "interface": "unix_seqpacket", "channel": "the drive's", "watchdog_ms": 200},
}
FIRMWARE: Final = "mps2-an385"
pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("forked")]
BEFORE: Final = ("doctor", "zero_current", "by_hand")
MOST_RELEASES: Final = 12
"""A step that the machine disturbs is tried again."""
SWUNG_COMMANDS: Final = 400
PATIENT: Final = {
    "servo.rate_hz": FIRMWARE_RATE_HZ,
    "driver.watchdog_ms": 1000,
    "safety.missed_exchanges": 100,
    "safety.guard": "off",
}
"""Nothing but the hand ends the swing, and it begins at once."""
ATTEMPTS: Final = 3
TURNED_AT_S: Final = (1.5, 7.0)


def hand(config: Config) -> list[dict[str, Any]]:
    """A turn forwards and one back, counted from the amplifier's first time on."""
    steps = []
    for at, travel in zip(TURNED_AT_S, (2 * pi, -2 * pi), strict=True):
        force, seconds = turning_force(config, travel)
        steps += [
            {"at_s": at, "from": "enabled", "force": force},
            {"at_s": at + seconds, "from": "enabled", "force": 0.0},
        ]
    return steps


def results(wire: str, folder: Path, *steps: str, **given: Any) -> dict[str, Result]:
    """What steps find on a device of that wire, anew where this machine disturbed them; see `_results`."""
    for attempt in range(ATTEMPTS):
        found = _results(wire, folder / str(attempt), *steps, **given)
        disturbed = [result.finding for result in found.values() if result.result == "disturbed"]
        if not disturbed:
            return found
    pytest.skip(disturbed[0])


def _results(
    wire: str,
    folder: Path,
    *steps: str,
    start: Mapping[str, Any] | None = None,
    plant: Mapping[str, Any] | None = None,
    faults: Sequence[Mapping[str, Any]] = (),
    rate_hz: float = 1000.0,
    settings: Mapping[str, Any] | None = None,
    operator: Callable[[Device], Nobody] = lambda device: Nobody(),
    image: Path | None = None,
) -> dict[str, Result]:
    """Once; the steps that come before are taken as passed."""
    board = None
    if wire == "firmware":
        require(FIRMWARE, image)
        board = FIRMWARE
        testbed = parse_config({**FIRMWARE_CONFIG, "driver": {**FIRMWARE_CONFIG["driver"], "watchdog_ms": 400}}, wire)
        config = slower_rig(testbed, testbed.servo.rate_hz, FIRMWARE_RATE_HZ)
    else:
        config = parse_config({"driver": WIRES[wire], "servo": {"rate_hz": rate_hz}}, wire)
    if settings:
        config = apply_settings(config, dict(settings), source=wire)
    if "enable" in steps:
        config = with_enable(config)
    real = apply_settings(config, dict(plant), source="the device") if plant else config
    script = {
        "start": dict(start or {}),
        "faults": list(faults),
        **({"hand": hand(real)} if "by_hand" in steps else {}),
    }
    device = Device(config, folder / "device", plant=real, script=script, board=board)
    device.command += ["--image", str(image)] if image else []
    with device:
        device.wait_ready()
        data = config.model_dump()
        data["driver"] |= device.options
        with Rig(parse_config(data, wire), folder, operator(device), lambda text: None, no_bar, Given()) as rig:
            friction = {"friction_A": config.plant.coulomb / config.amplifier.torque_constant}
            passed = {
                name: Result("pass", "taken as passed", friction) for name in (*BEFORE, "sign") if name not in steps
            }
            run.State(folder, rig.config).save(passed, 0.0)
            return run.commission(rig, only=steps)


@pytest.mark.parametrize("wire", [*WIRES, "firmware"])
@pytest.mark.parametrize(
    ("fault", "plant", "said"),
    [
        ("none", {}, ""),
        ("A and B exchanged", {"encoder.invert": True}, "exchanged"),
        ("lines for counts", {"encoder.counts_per_rev": 2048.0}, "counts_per_rev"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_by_hand(wire: str, fault: str, plant: dict[str, Any], said: str, tmp_path: Path) -> None:
    found = results(wire, tmp_path, "by_hand", plant=plant)["by_hand"]
    assert found.result == ("pass" if fault == "none" else "fail"), found.finding
    assert said in found.finding + found.cause


@pytest.mark.parametrize("wire", [*WIRES, "firmware"])
@pytest.mark.parametrize(("gain", "said"), [(-1, "backwards"), (10, "times as much"), (0, "nothing moves")])
def test_sign(wire: str, gain: float, said: str, tmp_path: Path) -> None:
    found = results(wire, tmp_path, "sign", start={"current_gain": gain})["sign"]
    assert found.result == "fail"
    assert found.dangerous
    assert said in found.finding


def test_the_sign_on_a_drive_of_other_hands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is plain Python: no faster than in its fault matrix."""
    monkeypatch.setattr("tests.commission.test_wires.Device", OtherDrive)
    found = results("can", tmp_path, "sign", start={"current_gain": -1}, rate_hz=200.0)["sign"]
    assert found.result == "fail"
    assert found.dangerous
    assert "backwards" in found.finding


@pytest.mark.parametrize("wire", [*WIRES, "firmware"])
@pytest.mark.parametrize("works", [1, 0], ids=["works", "dead"])
def test_watchdog(wire: str, works: int, tmp_path: Path) -> None:
    """The firmware's is dead in a binary of its own."""
    if wire == "firmware":
        found = results(wire, tmp_path, "sign", "watchdog", image=None if works else NO_WATCHDOG)
    else:
        found = results(wire, tmp_path, "sign", "watchdog", start={"watchdog": works})
    assert found["sign"].result == "pass", found["sign"].finding
    assert found["watchdog"].result == ("pass" if works else "fail"), found["watchdog"].finding
    assert found["watchdog"].dangerous == (not works)


class Finger(Nobody):
    """At the device's enable switch: does as it is told, and lets go of a swinging shaft once it has seen the current."""

    def __init__(self, device: Device) -> None:
        self._device, self._held, self._swings = device, True, False
        self._watching = threading.Thread()

    def does(self, request: str) -> bool:
        """Follow a request; the one before is over."""
        self._swings = False
        if self._watching.is_alive():
            self._watching.join()
        if request.startswith("The shaft is going to swing"):
            self._swings = True
            self._watching = threading.Thread(target=self._let_go_of_a_swing, daemon=True)
            self._watching.start()
        else:
            self._switch(held=request.startswith("Hold"))
        return True

    def _switch(self, *, held: bool) -> None:
        if held != self._held:
            self._held = held
            self._device.signal(signal.SIGUSR1)

    def _let_go_of_a_swing(self) -> None:
        asked_ns = time.monotonic_ns()
        for seen, held in ((self._pushed, False), (self._off, True)):
            while not seen(asked_ns):
                if not self._swings:
                    return
                time.sleep(0.02)
            asked_ns = time.monotonic_ns()
            self._switch(held=held)

    def _pushed(self, since_ns: int) -> bool:
        log = self._device.read_log()
        return int(np.count_nonzero(log.command_A[log.time_ns > since_ns])) > SWUNG_COMMANDS

    def _off(self, since_ns: int) -> bool:
        log = self._device.read_log()
        return bool(np.any(log.event[log.time_ns > since_ns] == DISABLE))


@pytest.mark.parametrize("wire", [*WIRES, "firmware", "other drive"])
def test_the_enable(wire: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let go of with the amplifier off, then while the shaft swings; the finger waits for what it sees, as a person does."""
    if wire == "other drive":
        monkeypatch.setattr("tests.commission.test_wires.Device", OtherDrive)
        wire = "can"
    released = SWITCH * MOST_RELEASES
    found = results(wire, tmp_path, "enable", faults=released, operator=Finger, settings=PATIENT)["enable"]
    assert found.result == "pass", found
    assert found.figures["fault"] == "enable_released"


@pytest.mark.parametrize("wire", WIRES)
def test_an_enable_that_nobody_lets_go_of(wire: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapticd.commission.limits.HAND_S", 1.0)
    found = results(wire, tmp_path, "enable")["enable"]
    assert found.dangerous
    assert "reads held whatever the hand does" in found.finding
