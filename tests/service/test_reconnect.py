"""A device that is unplugged and plugged in again: opened again by itself, and nothing moves until a person clears."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.service import reconnect
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from hapticd.service.refusals import Refused
from hapticd.servo import faults
from sim_hw.kinds import UNPLUG
from sim_hw.log import ENABLE, read_log
from tests.polling import wait_until
from tests.sim_hw.boards import rows

from .daemons import SOCKET, daemon_on, state_home, wait_for_state
from .devices import ORIGIN_RAD, WATCHDOG_MS, Device, board, daemon_of, device_config, drive, powered_drive
from .test_daemon import run_for

__all__ = ["state_home"]


LIFE_GUARDING = 0x8130


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reconnect, "RETRY_S", 0.1)


def fault_once_latched(daemon: Daemon) -> dict[str, Any]:
    wait_for_state(daemon, "fault")
    wait_until(FaultLatch(SOCKET).path.exists, "the latch on disk")
    return dict(daemon.status()["fault"])


def wait_until_reopened(daemon: Daemon) -> None:
    wait_until(lambda: daemon.status()["fault"]["remedy"] == faults.REOPENED, "the device open again")


def start_again(daemon: Daemon, code: str) -> int:
    """What a person does when the device is back, every step of it being needed; the instant before the start."""
    latched = daemon.status()
    assert (latched["state"], latched["fault"]["code"]) == ("fault", code)
    assert latched["fault"]["time"] == FaultLatch(SOCKET).load()["time"]  # type: ignore[index]
    with pytest.raises(Refused, match="a fault is latched"):
        daemon.start()
    cleared = daemon.clear()
    assert cleared["state"] == "off"
    assert "its encoder may have begun to count anew" in cleared["position_unknown"]
    with pytest.raises(Refused, match="set the spring's origin, 'hapticd origin'"):
        daemon.start()
    here = daemon.rig.counts * daemon.rig.config.raw_resolution
    assert "'hapticd origin'" in cleared["position_unknown"]
    daemon.set({"spring.origin": here + ORIGIN_RAD})
    assert daemon.status()["position_unknown"] is None
    before_ns = time.monotonic_ns()
    assert daemon.start()["state"] == "running"
    assert daemon.rig.wait_ticks(100)
    assert daemon.status()["state"] == "running"
    return before_ns


def assert_no_current_before(log_path: Path, start_ns: int, watchdog_ms: int) -> None:
    """Until the start, by the device's own log, no current, and never enabled.

    An unplugged device lets go when its own watchdog says so, one that restarts at once.
    """
    log = read_log(log_path)
    lost = rows(log, "FAULT_INJECTED")[0]
    assert np.any(log[log["time_ns"] <= lost["time_ns"]]["applied_A"] != 0)
    off_ns = lost["time_ns"] + (1_000_000 * (watchdog_ms + 10) if lost["code"] == UNPLUG else 0)
    away = log[(log["time_ns"] > off_ns) & (log["time_ns"] < start_ns)]
    assert len(away) > 10
    assert np.all(away["applied_A"] == 0)
    assert not np.any(away["event"] == ENABLE)
    assert np.any(log[log["time_ns"] > start_ns]["applied_A"] != 0)


UNPLUGGED = "faults: [{at_s: 0.3, from: enabled, kind: unplug, duration_s: 1.5}]"
RESTARTED = "faults: [{at_s: 0.3, from: enabled, kind: reboot, off_s: 0.02}]"
POWER_CYCLED = "faults: [{at_s: 0.3, from: enabled, kind: reboot, off_s: 1.5}]"
FLAPPING = """
faults:
  - {at_s: 0.3, from: enabled, kind: unplug, duration_s: 1.0}
  - {at_s: 2.0, from: enabled, kind: unplug, duration_s: 0.2}
  - {at_s: 2.5, from: enabled, kind: reboot, off_s: 0.5}
  - {at_s: 3.5, from: enabled, kind: unplug, duration_s: 1.0}
  - {at_s: 4.6, from: enabled, kind: reboot, off_s: 0.05}
"""
FLAPPED_S = 5.0


@pytest.mark.parametrize("device", [board, drive])
@pytest.mark.parametrize(
    ("script", "codes"),
    [
        (UNPLUGGED, {"driver_lost"}),
        (RESTARTED, {"driver_lost"}),
        (POWER_CYCLED, {"missed_exchanges"}),  # and only later is it known that the device has restarted
    ],
    ids=["unplugged", "restarted", "power_cycled"],
)
def test_a_lost_device_is_opened_again_and_stays_off_until_a_person_starts_it(
    tmp_path: Path, device: Device, script: str, codes: set[str]
) -> None:
    with device(tmp_path, script) as (settings, log), daemon_of(settings) as daemon:
        daemon.start()
        code = fault_once_latched(daemon)["code"]
        assert code in codes
        wait_until_reopened(daemon)
        start_ns = start_again(daemon, code)
        daemon.stop()
        wait_until(lambda: read_log(log)["time_ns"][-1] > start_ns + 100_000_000, "the device's log")
        assert_no_current_before(log, start_ns, WATCHDOG_MS[settings.driver.name])


@pytest.mark.parametrize("device", [board, drive])
def test_a_device_that_comes_and_goes(tmp_path: Path, device: Device, caplog: pytest.LogCaptureFixture) -> None:
    with device(tmp_path, FLAPPING) as (settings, log), daemon_of(settings) as daemon:
        daemon.start()
        code = fault_once_latched(daemon)["code"]
        time.sleep(FLAPPED_S)
        wait_until_reopened(daemon)
        start_ns = start_again(daemon, code)
        daemon.stop()
        wait_until(lambda: read_log(log)["time_ns"][-1] > start_ns + 100_000_000, "the device's log")
        assert_no_current_before(log, start_ns, WATCHDOG_MS[settings.driver.name])
    assert not [record for record in caplog.records if record.exc_info]
    assert len([record for record in caplog.records if "not back yet" in record.message]) < 20


def test_a_drive_that_was_switched_off_and_on_has_its_settings_again(tmp_path: Path) -> None:
    """Another process is another drive: all that the first one was told is gone, the watchdog too."""
    first, second = tmp_path / "first.arrow", tmp_path / "second.arrow"
    settings = device_config(tmp_path / "runs", "canopen", interface="unix_seqpacket", channel=str(tmp_path / "bus"))
    with ExitStack() as power:
        power.enter_context(powered_drive(tmp_path, first))
        with daemon_of(settings) as daemon:
            daemon.start()
            power.close()
            assert fault_once_latched(daemon)["remedy"] == faults.REOPENS
            with pytest.raises(Refused, match=r"the fault is still there: .*plug it in"):
                daemon.clear()
            power.enter_context(powered_drive(tmp_path, second))
            wait_until_reopened(daemon)
            start_again(daemon, "driver_lost")
            daemon.rig.servo.stop()  # a loop that is gone: nobody sends the drive a sign of life
            wait_until(lambda: LIFE_GUARDING in rows(read_log(second), "EMCY")["code"], "the drive's own watchdog")


def test_without_reconnect_a_device_stays_lost(tmp_path: Path) -> None:
    with board(tmp_path, UNPLUGGED, reconnect=False) as (settings, _), daemon_of(settings) as daemon:
        daemon.start()
        assert fault_once_latched(daemon)["remedy"] == faults.REPLUG
        wait_until((tmp_path / "board").is_symlink, "the port's return")
        time.sleep(1.0)
        assert "plug it in" in daemon.status()["fault"]["remedy"]
        with pytest.raises(Refused, match="the fault is still there"):
            daemon.clear()


def test_an_end_while_the_device_is_away_waits_for_nothing(tmp_path: Path) -> None:
    with board(tmp_path, "faults: [{at_s: 0.1, from: enabled, kind: unplug}]") as (settings, _):
        with daemon_of(settings) as daemon:
            daemon.start()
            wait_for_state(daemon, "fault")
            time.sleep(0.5)
            begin = time.monotonic()
        assert time.monotonic() - begin < 5.0


def test_a_fault_knows_when_and_under_which_config_it_was_latched(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0) as (daemon, (device,)):
        run_for(daemon, device)
        found = daemon.estop()
        wait_until(FaultLatch(SOCKET).path.exists, "the latch on disk")
        first = daemon.status()["fault"]
        assert first["from_before"] is False
        assert (first["config"], first["config_digest"]) == ("re35 (built in)", found["config_digest"])
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, spring={"stiffness": 0.001}) as (daemon, _):
        again = daemon.status()
        assert again["fault"] == {**first, "from_before": True}
        assert again["config_digest"] != first["config_digest"]
        assert daemon.clear()["fault"] is None
