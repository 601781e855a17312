"""What the motor has taken outlives a reload and a restart; cooling is credited only where it is known to have happened."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest

from hapticd.service.heat import Heat
from hapticd.service.latch import daemon_name
from hapticd.servo.core import i2t_limit
from tests.service.daemons import SOCKET, daemon_on, state_home
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
