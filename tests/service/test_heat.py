"""What the motor has taken outlives a reload and a restart; cooling is credited only where it is known to have happened."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.record.flight import FlightRing, memory_directory
from hapticd.service import flight
from hapticd.service.heat import Heat
from hapticd.service.latch import daemon_name
from hapticd.servo import atomics
from hapticd.servo.core import i2t_limit
from tests.polling import wait_until
from tests.service.daemons import SOCKET, daemon_on, state_home
from tests.service.processes import Rig
from tests.servo.scripted import config

pytestmark = pytest.mark.realtime
__all__ = ["state_home"]

CONFIG = config(amplifier={"continuous_current": 2.0, "peak_current": 6.0})
BOOT = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
SLOW = {"continuous_current": 0.1, "peak_current": 6.0}
"""A motor that cools by 0.01 A² s a second: what is left after some seconds is what was there."""


def kept(**changes: Any) -> float:
    """I²t at a start, of a file that said 20 A² s."""
    heat = Heat("rig")
    now = {"time_s": time.time(), "boot_s": time.clock_gettime(time.CLOCK_BOOTTIME), "boot": BOOT}
    heat.path.parent.mkdir(parents=True, exist_ok=True)
    heat.path.write_text(json.dumps({"i2t": 20.0, "clean": True, **now, **changes}))
    return heat.before(CONFIG)


def ago(seconds: float, clock: int = time.CLOCK_BOOTTIME) -> float:
    return time.clock_gettime(clock) - seconds


def test_cooling_is_credited_after_a_clean_end() -> None:
    assert kept(boot_s=ago(3.0)) == pytest.approx(20.0 - 4.0 * 3.0, abs=1.0)
    assert kept(boot_s=ago(3600.0)) == 0.0


@pytest.mark.parametrize(
    "changes",
    [
        {"clean": False, "boot_s": ago(3600.0)},
        {"boot_s": ago(-3600.0)},
        {"boot": "another", "time_s": ago(-3600.0, time.CLOCK_REALTIME)},
        {"clean": "yes", "boot_s": ago(3600.0)},
    ],
    ids=["killed", "boot clock back", "calendar back over a reboot", "no flag"],
)
def test_no_cooling_is_credited_where_it_is_not_known(changes: dict[str, Any]) -> None:
    assert kept(**changes) == pytest.approx(20.0, abs=0.1)


def test_over_a_reboot_the_calendar_counts() -> None:
    assert kept(boot="another", boot_s=1e9, time_s=ago(2.0, time.CLOCK_REALTIME)) == pytest.approx(12.0, abs=1.0)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"i2t": -1, "clean": true}', '{"i2t": NaN, "clean": true}', "[" * 9999]
)
def test_a_file_that_cannot_be_understood_is_a_hot_motor(text: str) -> None:
    heat = Heat("rig")
    heat.path.parent.mkdir(parents=True, exist_ok=True)
    heat.path.write_text(text)
    assert heat.before(CONFIG) == i2t_limit(CONFIG)


def test_no_file_is_a_cold_motor_and_no_limit_none() -> None:
    assert Heat("rig").before(CONFIG) == 0.0
    kept()
    assert Heat("rig").before(config(amplifier={"continuous_current": None})) == 0.0


def test_a_reload_begins_with_the_heat_of_the_rig_before(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text("amplifier: {continuous_current: 0.1, peak_current: 6.0}\nplant: {inertia: 7.0e-6}\n")
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, amplifier=SLOW) as (daemon, _):
        before = daemon.rig
        daemon.rig.core._state["i2t"] = 20.0
        daemon.reload(str(other))
        assert daemon.rig is not before
        assert daemon.rig.core.i2t == pytest.approx(20.0, abs=1.0)


def test_a_restart_begins_with_the_heat_of_the_daemon_before(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, amplifier=SLOW) as (daemon, _):
        daemon.rig.core._state["i2t"] = 20.0
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, amplifier=SLOW) as (daemon, _):
        assert daemon.rig.core.i2t == pytest.approx(20.0, abs=1.0)
    assert json.loads(Heat(daemon_name(SOCKET)).path.read_text())["clean"] is True


def test_a_daemon_writes_it_down_while_it_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, amplifier=SLOW) as (daemon, _):
        daemon.rig.core._state["i2t"] = 20.0
        path = Heat(daemon_name(SOCKET)).path
        deadline = time.monotonic() + 30.0
        while not (path.exists() and json.loads(path.read_text())["i2t"] > 19.0):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert json.loads(path.read_text())["clean"] is False


def dead_daemon(folder: Path, i2t: float, words: int = atomics.SIZE) -> None:
    """What a daemon that was killed with this I²t leaves, with one row."""
    ring = FlightRing.create(folder, "rig", 16, words, atomics.RING_HEAD)
    ring.shared[atomics.RING_HEAD] = 1
    if words > atomics.I2T:
        ring.shared.view(np.float64)[atomics.I2T] = i2t
    ring.describe({"config": {"record": {"directory": str(folder / "runs")}}})
    ring.leave()


@pytest.mark.parametrize(
    ("left", "begins"), [(27.0, 27.0), (5.0, 20.0), (1e9, 32.0), (float("nan"), 32.0), (-1.0, 32.0)]
)
def test_after_a_kill_the_larger_of_disk_and_flight_recorder_counts_and_no_cooling(
    tmp_path: Path, left: float, begins: float
) -> None:
    """The disk says of a clean end an hour ago: the daemon that was killed since has not got to write."""
    kept(boot_s=ago(3600.0))
    dead_daemon(tmp_path, left)
    assert len(flight.recover(tmp_path, "rig")) == 1
    assert not list(tmp_path.glob("*.flight"))
    assert Heat("rig").before(CONFIG) == begins


def test_a_flight_recorder_of_fewer_words_is_read_without_its_heat(tmp_path: Path) -> None:
    kept()
    dead_daemon(tmp_path, 27.0, atomics.I2T)
    assert len(flight.recover(tmp_path, "rig")) == 1
    assert Heat("rig").before(CONFIG) == 20.0


def test_what_the_flight_recorder_has_counts_though_nothing_can_be_written(tmp_path: Path) -> None:
    dead_daemon(tmp_path / "memory", 27.0)
    Heat("rig").path.parent.parent.mkdir(exist_ok=True)
    Heat("rig").path.parent.write_text("in the way")
    assert flight.recover(tmp_path / "memory", "rig") == []
    left = flight.heat_left(config(record={"flight_directory": str(tmp_path / "memory")}), "rig")
    assert left == 27.0
    assert Heat("other").before(CONFIG, left) == i2t_limit(CONFIG)
    Heat("rig").path.parent.unlink()
    assert Heat("rig").before(CONFIG, left) == 27.0


def test_fault_and_heat_of_what_can_become_no_run_are_taken_over_once(tmp_path: Path) -> None:
    dead_daemon(tmp_path, 27.0)
    (tmp_path / "runs").write_text("in the way")
    (left,) = tmp_path.glob("*.flight")
    ring_config = config(record={"flight_directory": str(tmp_path)})
    assert flight.recover(tmp_path, "rig") == []
    assert left.exists()
    assert Heat("rig").before(CONFIG, flight.heat_left(ring_config, "rig")) == 27.0
    kept(boot_s=ago(3600.0))  # a daemon that has ended well since, and its motor has cooled down
    assert flight.recover(tmp_path, "rig") == []
    assert Heat("rig").before(CONFIG, flight.heat_left(ring_config, "rig")) == 0.0
    (tmp_path / "runs").unlink()
    assert len(flight.recover(tmp_path, "rig")) == 1
    assert not list(tmp_path.glob("rig-*"))


def test_no_file_says_clean_of_a_daemon_that_runs() -> None:
    kept(boot_s=ago(3600.0))
    heat = Heat("rig")
    heat.follow(lambda: 3.0)
    assert json.loads(heat.path.read_text())["clean"] is False
    heat.end()
    assert json.loads(heat.path.read_text())["clean"] is True


def test_it_is_on_disk_before_its_flight_recorder_goes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen: list[tuple[float, bool]] = []
    remove = FlightRing.remove

    def looked_at(ring: FlightRing) -> None:
        on_disk = json.loads(Heat(daemon_name(SOCKET)).path.read_text())
        seen.append((on_disk["i2t"], on_disk["clean"]))
        remove(ring)

    monkeypatch.setattr(FlightRing, "remove", looked_at)
    other = tmp_path / "other.yaml"
    other.write_text("amplifier: {continuous_current: 0.1, peak_current: 6.0}\nplant: {inertia: 7.0e-6}\n")
    memory = {"flight_directory": str(tmp_path / "memory")}
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, amplifier=SLOW, record=memory) as (daemon, _):
        daemon.rig.core._state["i2t"] = 20.0
        daemon.reload(str(other))
        assert seen == [(pytest.approx(20.0, abs=0.5), False)]
    assert seen[1:] == [(pytest.approx(20.0, abs=1.0), True)]


@pytest.mark.skipif(memory_directory() is None, reason="no file system in memory here")
def test_a_motor_heated_again_and_again_by_daemons_that_are_killed_trips(tmp_path: Path) -> None:
    """Each is killed within the second after which it would have written to the disk; 1 s at the peak is all there is."""
    rig = Rig(
        tmp_path,
        amplifier={**SLOW, "bandwidth_hz": 0, "dac_bits": 0},
        spring={"stiffness": 10.0},
        safety={"guard": "off", "soft_start_s": 0, "heartbeat_timeout_s": 5, "missed_exchanges": 0},
    )

    def ticks() -> int:
        return sum(line == "-6.0 1" for line in rig.commands()) if rig.log.exists() else 0

    for _ in range(6):
        process, before = rig.launch(), ticks()
        rig.client.start()
        wait_until(
            lambda before=before: ticks() > before + 400 or rig.client.status()["fault"] is not None,  # type: ignore[misc]
            "a hot motor",
        )
        fault = rig.client.status()["fault"]
        process.kill()
        process.wait()
        if fault is not None:
            assert fault["code"] == "over_current"
            break
    assert len(rig.processes) > 1
    assert ticks() <= 1000 + 3 * len(rig.processes)  # the last command of each is not added up any more
