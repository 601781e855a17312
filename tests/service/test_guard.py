"""The guard in the daemon: what it refuses changes nothing, and what is forced is written down."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drivers
from hapticd.config import config_to_yaml
from hapticd.record import Run, read_run
from hapticd.service.experiments import excited_deflection
from hapticd.service.refusals import Refused
from sim_hw.log import ENABLE, read_log
from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home
from tests.service.devices import Device, board, daemon_of, drive
from tests.servo.scripted import config

__all__ = ["state_home"]

pytestmark = pytest.mark.realtime

RUNAWAY = {"encoder.decimation": "217", "spring.stiffness": "0.5"}
UNSTABLE: dict[str, Any] = {"encoder": {"decimation": 217}, "spring": {"stiffness": 0.5}}


def recorded(folder: Path) -> Run:
    """The one run in the folder of a test."""
    (path,) = (folder / "runs").iterdir()
    return read_run(path)


def test_start_says_where_theory_sees_the_spring(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, _devices):
        guard = daemon.start()["guard"]
        assert (guard["verdict"], guard["force"]) == ("admitted", False)
        assert guard["reason"].startswith("region A, at rest 100 ticks from the origin: globally stable")
        daemon.stop()
        assert recorded(tmp_path).metadata["guard"] == guard


def test_a_spring_that_would_shake_is_not_rendered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, **UNSTABLE) as (daemon, (device,)):
        with pytest.raises(Refused, match=r"(?s)region C.*spring.stiffness +0.5 → ") as refusal:
            daemon.start()
        assert refusal.value.code == "unstable"
        assert daemon.status()["state"] == "off"
        for begin in (lambda: daemon.release(3.3, 1.0), lambda: daemon.excite("chirp", amplitude=0.1)):
            with pytest.raises(Refused, match="region C"):
                begin()
        assert {on for _, on in list(device.commands)} == {False}
        assert not list((tmp_path / "runs").glob("*"))


@pytest.mark.parametrize("device", [board, drive])
def test_no_device_is_told_to_render_what_is_refused(tmp_path: Path, device: Device) -> None:
    with device(tmp_path) as (settings, log), daemon_of(settings) as daemon:
        daemon.set(RUNAWAY, force=True)
        with pytest.raises(Refused, match="region C"):
            daemon.start()
        assert daemon.rig.wait_ticks(100)
        daemon.set({"encoder.decimation": 1, "spring.stiffness": 0.012})
        before_ns = time.monotonic_ns()
        assert daemon.start()["guard"]["verdict"] == "admitted"
        assert daemon.rig.wait_ticks(100)
        with pytest.raises(Refused, match="region C"):
            daemon.set(RUNAWAY)
        assert daemon.status()["state"] == "running"
        daemon.stop()
        wait_until(lambda: bool(np.any(read_log(log)["applied_A"] != 0)), "a current in the device's log")
        early = read_log(log)
        early = early[early["time_ns"] < before_ns]
        assert len(early) > 100
        assert not np.any(early["event"] == ENABLE)
        assert np.all(early["applied_A"] == 0)


def test_force_renders_and_is_in_the_run_and_in_the_log(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, **UNSTABLE) as (daemon, _devices):
        with caplog.at_level(logging.WARNING):
            answer = daemon.start(force=True)
        assert (answer["state"], answer["guard"]["verdict"], answer["guard"]["force"]) == ("running", "forced", True)
        daemon.stop()
        assert recorded(tmp_path).metadata["guard"] == answer["guard"]
    assert "forced by the stability guard: region C" in caplog.text


def test_a_set_that_is_refused_changes_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0) as (daemon, _devices):
        daemon.start()
        before = daemon.status()
        with pytest.raises(Refused, match="region C"):
            daemon.set(RUNAWAY)
        after = daemon.status()
        for key in ("state", "config_digest", "settings_epoch", "operating_point"):
            assert after[key] == before[key]
        forced = daemon.set(RUNAWAY, force=True)
        assert forced["guard"]["verdict"] == "forced"
        assert forced["applied"] == {"encoder.decimation": 217, "spring.stiffness": 0.5}
        daemon.stop()
        (event,) = (event for event in recorded(tmp_path).events if event["event"] == "set")
        assert event["guard"] == forced["guard"]


def test_what_theory_does_not_look_at_can_be_set_in_an_unstable_spring(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, **UNSTABLE) as (daemon, _devices):
        daemon.start(force=True)
        assert daemon.set({"safety.max_velocity": "50"})["guard"] is None


@pytest.mark.parametrize(("policy", "verdict"), [("warn", "warned"), ("off", "off")])
def test_policies(
    policy: str, verdict: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with (
        caplog.at_level(logging.WARNING),
        daemon_on(monkeypatch, tmp_path, lambda n: 0, **UNSTABLE, safety={"guard": policy}) as (daemon, _devices),
    ):
        answer = daemon.start()
        assert (answer["state"], answer["guard"]["verdict"]) == ("running", verdict)
    assert ("warned by the stability guard: region C" in caplog.text) == (policy == "warn")


def test_the_speed_of_a_release_decides(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    slow: dict[str, Any] = {"servo": {"rate_hz": 100}, "encoder": {"decimation": 217}}
    with daemon_on(monkeypatch, tmp_path, **slow) as (daemon, _devices):
        with pytest.raises(Refused, match=r"(?s)region D, at rest 10.3 ticks.*speed limit.*a faster servo"):
            daemon.release(10.3, 0.5)
        answer = daemon.release(2.3, 0.5)
        assert answer["guard"]["region"] == "E"
        wait_until(lambda: daemon.experiment()["state"] != "running", "the end of the release")


def test_a_reload_is_judged_before_the_rig_is_touched(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    unstable = config(**UNSTABLE, driver={"name": "other"}, record={"directory": str(tmp_path / "runs")})
    path = tmp_path / "unstable.yaml"
    path.write_text(config_to_yaml(unstable))
    with daemon_on(monkeypatch, tmp_path, lambda n: 0) as (daemon, devices):
        made = drivers.create
        with pytest.raises(Refused, match="region C"):
            daemon.reload(str(path))
        assert not devices[0].closed
        assert daemon.rig.config.spring.stiffness == 0.012
        assert drivers.create is made
        assert daemon.reload(str(path), force=True)["guard"]["verdict"] == "forced"
        assert daemon.rig.config.spring.stiffness == 0.5


def test_an_excitation_is_judged_by_its_steps_and_by_its_speed() -> None:
    rig = config(encoder={"decimation": 217})
    steps = np.zeros((2, 1000))
    steps[0, 100:] = 0.1
    # 0.1 A × 0.0292 N m/A against 0.012 N m/rad × 217 counts
    assert excited_deflection(rig, steps) == pytest.approx(0.1 * 0.0292 / (0.012 * rig.resolution))
    slow = np.zeros((2, 4000))
    slow[1] = np.linspace(0.0, 217 * 40.0, 4000)
    # 40 ticks of way at 0.01 tick a period: as slow as a release from √μ of that
    assert excited_deflection(rig, slow) < 1.0 < 0.1 * 40.0


def test_a_start_or_a_change_that_would_pass_a_limit_is_refused_with_both_numbers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, safety={"soft_start_s": 0.25}) as (daemon, _devices):
        daemon.set({"spring.origin": 9.9})
        with pytest.raises(Refused, match=r"(?s)over_speed.* rad/s is above safety.max_velocity = 400 rad/s") as no:
            daemon.start()
        assert no.value.code == "limits"
        assert daemon.status()["state"] == "off"
        daemon.set({"spring.origin": 1.0})
        guard = daemon.start()["guard"]
        assert guard["verdict"] == "admitted"
        assert guard["predicted"]["fault"] is None
        assert guard["predicted"]["peak_current_A"] == pytest.approx(0.41, rel=0.01)
        with pytest.raises(Refused, match=r"safety.max_excursion = 10 rad"):
            daemon.set({"spring.origin": 14})
        assert daemon.status()["state"] == "running"
        assert daemon.set({"spring.origin": 14, "safety.guard": "off"})["guard"]["predicted"] is None
        wait_until(lambda: daemon.status()["state"] == "fault", "the fault that nobody wanted to hear of")
        assert daemon.status()["fault"]["code"] == "excursion"


def test_a_release_is_exact_and_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, safety={"soft_start_s": 5.0}) as (daemon, (device,)):
        answer = daemon.release(1000.0, 0.5)
        assert answer["soft_start_s"] == 0.0
        assert answer["guard"]["predicted"] is None
        wait_until(lambda: any(current for current, _ in device.commands), "a current")
        first = next(current for current, _ in device.commands if current)
        assert first == pytest.approx(-0.012 * 1000.5 * config().raw_resolution / 0.0292, rel=1e-3)
        wait_until(lambda: daemon.experiment()["state"] != "running", "its end")
        daemon.start()
        wait_until(lambda: daemon.status()["current"] != 0.0, "a soft start's first currents")
        assert abs(daemon.status()["current"]) < abs(first)
