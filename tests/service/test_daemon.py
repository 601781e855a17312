"""The daemon in real time: states, every way out as the device sees it, faults that outlive a restart, live changes."""

from __future__ import annotations

import contextlib
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drivers
from drivers import DriverError
from hapticd.config import ConfigError, config_to_yaml
from hapticd.record import read_run
from hapticd.record.schema import FLAG_HELD
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.servo import thread as servo_thread
from hapticd.servo.authority import Withdrawn
from hapticd.servo.excitation import ExcitationError
from tests.polling import wait_until
from tests.service.daemons import SOCKET, daemon_on, state_home, undisturbed, wait_for_state
from tests.servo.scripted import Scripted, config

__all__ = ["state_home"]

pytestmark = pytest.mark.realtime


def ends_at_zero(device: Scripted) -> None:
    """After the last current: zero with the amplifier on, then only zero with it off."""
    commands = list(device.commands)
    last = max(index for index, (current, _) in enumerate(commands) if current != 0.0)
    after = commands[last + 1 :]
    on = after.index((0.0, False))
    assert on >= 1
    assert set(after[:on]) == {(0.0, True)}
    assert set(after[on:]) == {(0.0, False)}


def run_for(daemon: Daemon, device: Scripted, commands: int = 20) -> None:
    """Render until the device has seen some currents."""
    daemon.start()
    wait_until(lambda: sum(current != 0.0 for current, _ in list(device.commands)) > commands, "currents")


def test_nothing_moves_before_start_and_stop_ends_at_zero(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, (device,)):
        wait_until(lambda: len(device.commands) > 20, "ticks in off")
        assert set(device.commands) == {(0.0, False)}
        run_for(daemon, device)
        assert daemon.status()["state"] == "running"
        assert daemon.stop()["state"] == "off"
        wait_until(lambda: device.commands[-1] == (0.0, False), "amplifier off")
        ends_at_zero(device)


def test_shutdown_while_running_ends_at_zero(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, (device,)):
        run_for(daemon, device)
        daemon.shutdown()
        ends_at_zero(device)
        assert device.closed


def test_estop_latches_and_survives_a_restart(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, (device,)):
        run_for(daemon, device)
        assert daemon.estop()["fault"]["code"] == "estop"
        wait_until(lambda: device.commands[-1] == (0.0, False), "amplifier off")
        ends_at_zero(device)
        wait_until(FaultLatch(SOCKET).path.exists, "the latch on disk")
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, (device,)):
        status = daemon.status()
        assert status["state"] == "fault"
        assert status["fault"]["code"] == "estop"
        with pytest.raises(
            Refused, match=r"a fault is latched \(estop: .*\); when nobody can be hurt, 'hapticd clear'"
        ):
            daemon.start()
        assert daemon.clear()["state"] == "off"
        assert set(device.commands) == {(0.0, False)}
    assert not FaultLatch(SOCKET).path.exists()


def test_an_unreadable_latch_is_a_fault_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    latch = FaultLatch(SOCKET)
    latch.path.parent.mkdir(parents=True)
    latch.path.write_text("{")
    with daemon_on(monkeypatch, tmp_path, lambda n: 0) as (daemon, _):
        assert daemon.status()["state"] == "fault"
        assert "cannot be read" in daemon.status()["fault"]["cause"]


def test_exception_in_the_driver_is_quoted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bad = [False]
    script = lambda n: RuntimeError("checksum of frame 7") if bad[0] else 100  # noqa: E731
    with daemon_on(monkeypatch, tmp_path, script) as (daemon, (device,)):
        run_for(daemon, device)
        bad[0] = True
        fault = wait_for_state(daemon, "fault")["fault"]
        wait_until(lambda: device.commands[-1] == (0.0, False), "amplifier off")
        ends_at_zero(device)
        assert fault["code"] == "driver_error"
        assert fault["cause"].endswith("RuntimeError: checksum of frame 7")
        assert fault["help"] == "hapticd help driver_error"
        with pytest.raises(Refused, match=r"the fault is still there"):
            daemon.clear()
        bad[0] = False
        assert daemon.clear()["state"] == "off"


def test_lost_heartbeat(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    safety = {"heartbeat_timeout_s": 2}
    with daemon_on(monkeypatch, tmp_path, lambda n: 100, safety=safety) as (daemon, (device,)):
        run_for(daemon, device)
        monkeypatch.setattr(servo_thread.ServoThread, "beat", lambda self: None)
        fault = wait_for_state(daemon, "fault")["fault"]
        assert fault["code"] == "heartbeat_lost"
        wait_until(lambda: device.commands[-1] == (0.0, False), "amplifier off")
        ends_at_zero(device)


def test_with_the_motor_off_nobody_needs_a_heartbeat(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    safety = {"heartbeat_timeout_s": 0.2}
    with daemon_on(monkeypatch, tmp_path, lambda n: 100, safety=safety) as (daemon, (device,)):
        monkeypatch.setattr(servo_thread.ServoThread, "beat", lambda self: None)
        time.sleep(0.6)
        assert daemon.status()["state"] == "off"
        with contextlib.suppress(Refused):  # the fault may be there before the answer
            daemon.start()
        assert wait_for_state(daemon, "fault")["fault"]["code"] == "heartbeat_lost"
        assert all(current == 0.0 for current, _ in device.commands)


def test_overrun_fault(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    slow = [False]

    def script(n: int) -> int:
        if slow[0]:
            time.sleep(0.01)
        return 100

    sections: dict[str, Any] = {"servo": {"overrun": {"policy": "skip", "fault_after": 5}}}
    with daemon_on(monkeypatch, tmp_path, script, **sections) as (daemon, (device,)):
        run_for(daemon, device)
        slow[0] = True
        fault = wait_for_state(daemon, "fault")["fault"]
        slow[0] = False
        assert fault["code"] == "overrun"
        assert daemon.status()["timing"]["missed"] >= 5
        wait_until(lambda: device.commands[-1] == (0.0, False), "amplifier off")
        ends_at_zero(device)


def test_the_ten_seconds_before_a_fault_are_kept_without_a_recording(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 100, record={"enabled": False}) as (daemon, (device,)):
        run_for(daemon, device, 300)
        tripped = daemon.estop()
        assert tripped["recorder"]["path"] is None
        wait_until(lambda: bool(list((tmp_path / "runs").glob("fault-*-estop.arrow"))), "the history on disk")
        daemon.shutdown()
        run = read_run(next((tmp_path / "runs").glob("fault-*-estop.arrow")))
        assert len(run.columns["tick"]) > 300
        assert (run.columns["current_command_A"] != 0.0).sum() > 300
        assert run.columns["current_command_A"][-1] == 0.0


def test_runs_are_recorded_from_start_to_stop(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, (device,)):
        assert daemon.status()["recorder"]["path"] is None
        run_for(daemon, device)
        path = daemon.status()["recorder"]["path"]
        daemon.stop()
        assert daemon.status()["recorder"]["path"] is None
        run = read_run(Path(path))
        assert not run.truncated
        assert run.metadata["config"]["spring"]["stiffness"] == 0.012
        assert run.columns["current_command_A"][-1] == 0.0


def test_live_settings_are_applied_and_others_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 5000) as (daemon, (device,)):
        run_for(daemon, device)
        reply = daemon.set({"servo.rate_hz": "500", "encoder.decimation": "217"})
        assert reply["applied"] == {"servo.rate_hz": 500, "encoder.decimation": 217}
        status = daemon.status()
        assert status["timing"]["rate_hz"] == 500
        assert status["position_ticks"] == pytest.approx(5000 / 217)
        with pytest.raises(Refused, match=r"amplifier.torque_constant: cannot change while the daemon runs"):
            daemon.set({"amplifier.torque_constant": "0.05"})
        with pytest.raises(ConfigError, match=r"spring.stifness: unknown key; did you mean spring.stiffness"):
            daemon.set({"spring.stifness": "1"})
        with pytest.raises(ConfigError):
            daemon.set({"encoder.decimation": "2.5", "servo.rate_hz": "100"})
        assert daemon.status()["timing"]["rate_hz"] == 500


def test_a_rate_that_the_device_cannot_follow_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 5000) as (daemon, (device,)):
        monkeypatch.setattr(device, "check_rate", lambda rate: f"at most 600 Hz, not {rate:g}" if rate > 600 else None)
        with pytest.raises(
            Refused, match=r"^servo.rate_hz = 700 Hz: at most 600 Hz, not 700; the rate in force stays$"
        ):
            daemon.set({"servo.rate_hz": "700", "spring.stiffness": "0.001"})
        assert daemon.status()["timing"]["rate_hz"] == 1000
        assert daemon.set({"servo.rate_hz": "600"})["applied"] == {"servo.rate_hz": 600}


def test_bad_reload_is_refused_and_the_old_config_goes_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text("spring: {stiffness: -1}\n")
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, (device,)):
        run_for(daemon, device)
        with pytest.raises(ConfigError, match=r"spring.stiffness = -1"):
            daemon.reload(str(bad))
        assert daemon.status()["state"] == "running"
        other = tmp_path / "other.yaml"
        other.write_text(config_to_yaml(config(plant={"inertia": 1e-5}, record={"directory": str(tmp_path / "runs")})))
        with pytest.raises(Refused, match=r"plant.inertia: cannot change while the spring is rendered"):
            daemon.reload(str(other))
        assert daemon.status()["state"] == "running"
        daemon.stop()
        ends_at_zero(device)


def test_only_who_is_trusted_names_another_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What the daemon may read its caller perhaps may not; an error would quote it."""
    secret = tmp_path / "secret.yaml"
    secret.write_text("amplifier: {password: hunter2}")
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, _):
        directory = daemon.config()["record"]["directory"]
        with pytest.raises(Refused, match=r"only the daemon's own user or root") as refused:
            daemon.reload(str(secret), trusted=False)
        assert "hunter2" not in refused.value.message
        daemon.reload("re35", trusted=False)
        assert daemon.config()["record"]["directory"] == directory


def test_a_fault_that_nobody_has_noticed_yet_keeps_its_numbers_over_a_reload(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    other = tmp_path / "other.yaml"
    other.write_text("plant: {inertia: 7.0e-6}\n")
    monkeypatch.setattr("hapticd.service.daemon.BEAT_S", 3.0)  # the supervisor looks, but late
    with daemon_on(monkeypatch, tmp_path, lambda n: 100, safety={"max_excursion": 1.0, "guard": "off"}) as (daemon, _):
        daemon.start()
        daemon.set({"spring.origin": 3.0})
        wait_for_state(daemon, "fault")
        daemon.reload(str(other))
        cause = daemon.status()["fault"]["cause"]
    assert "is beyond safety.max_excursion = 1 rad" in cause


def test_reload_whose_driver_fails_ends_at_zero_with_a_latched_fault(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, opened):
        run_for(daemon, opened[0])
        daemon.stop()

        def failing(self: Scripted) -> None:
            if self.config.plant.inertia == 1e-5:
                raise DriverError("no such port /dev/ttyX")

        monkeypatch.setattr(Scripted, "connect", failing)
        other = tmp_path / "other.yaml"
        other.write_text(config_to_yaml(config(plant={"inertia": 1e-5}, record={"directory": str(tmp_path / "runs")})))
        with pytest.raises(DriverFailure, match=r"no such port"):
            daemon.reload(str(other))
        ends_at_zero(opened[0])
        assert opened[0].closed
        status = daemon.status()
        assert status["state"] == "fault"
        assert status["fault"]["code"] == "reload_failed"
        assert "no such port /dev/ttyX" in status["fault"]["cause"]
        assert json.loads(FaultLatch(SOCKET).path.read_text())["code"] == "reload_failed"
        assert set(opened[-1].commands) <= {(0.0, False)}
        daemon.clear()
        assert daemon.status()["state"] == "off"


def test_reload_that_names_no_driver_leaves_everything_in_force(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        other = tmp_path / "other.yaml"
        record = {"directory": str(tmp_path / "runs")}
        other.write_text(config_to_yaml(config(driver={"name": "loopbak"}, record=record)))
        with pytest.raises(Refused, match=r"did you mean 'loopback'.*the present configuration stays"):
            daemon.reload(str(other))
        assert daemon.status()["state"] == "off"
        other.write_text(config_to_yaml(config(api={"socket": "/tmp/elsewhere.sock"}, record=record)))
        with pytest.raises(Refused, match=r"api.socket.*cannot change without a restart"):
            daemon.reload(str(other))


def test_refused_release_leaves_the_spring_and_its_recording_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, encoder={"decimation": 217}) as (daemon, _):
        daemon.start()
        with pytest.raises(Refused, match=r"beyond safety.max_excursion"):
            daemon.release(100.0, None)
        assert daemon.status()["state"] == "running"
        daemon.stop()
        assert daemon.status()["recorder"]["path"] is None


def test_disable_stops_the_motor_for_good(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, (device,)):
        run_for(daemon, device)
        daemon.disable()
        wait_until(lambda: device.commands[-1] == (0.0, False), "amplifier off")
        with pytest.raises(Withdrawn):
            daemon.start()
        ends_at_zero(device)


def test_start_far_from_the_origin_says_how_to_go_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 20_000) as (daemon, _):
        wait_until(lambda: daemon.status()["encoder_counts"] == 20_000, "a sample")
        with pytest.raises(Refused, match=r"'hapticd origin'") as refused:
            daemon.start()
        assert refused.value.choice["remedies"][0]["after"] == pytest.approx(15.34, abs=0.01)
        assert daemon.origin()["applied"]["spring.origin"] == pytest.approx(15.34, abs=0.01)
        assert daemon.start()["state"] == "running"


def test_a_damaged_latch_is_a_fault_and_no_crash(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    latch = FaultLatch(SOCKET)
    latch.path.parent.mkdir(parents=True)
    latch.path.write_text('{"code": "estop"}')
    with daemon_on(monkeypatch, tmp_path, lambda n: 0) as (daemon, _):
        assert "cannot be read" in daemon.status()["fault"]["cause"]


def test_a_driver_that_cannot_be_opened_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Broken(Scripted):
        def connect(self) -> None:
            raise DriverError("nobody answers")

    made: list[Broken] = []

    def create(cfg: Any) -> Broken:
        made.append(Broken(cfg))
        return made[-1]

    monkeypatch.setattr(drivers, "create", create)
    with pytest.raises(DriverError, match=r"nobody answers"):
        Daemon(config(record={"directory": str(tmp_path / "runs")}), None, FaultLatch(SOCKET))
    assert made[0].closed
    assert not (tmp_path / "runs").exists()


def test_excite_plays_records_and_ends_off(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        reply = daemon.excite("chirp", amplitude=0.3, duration_s=1.0)
        with pytest.raises(Refused, match=r"is running; 'hapticd stop' ends it"):
            daemon.excite("chirp")
        wait_until(lambda: daemon.experiment()["state"] != "running", "the end of the experiment")
        assert daemon.experiment()["state"] == "done"
        assert daemon.status()["state"] == "off"
        run = read_run(Path(reply["run"]))
        assert run.columns["current_command_A"].max() > 0.25
        assert run.columns["current_command_A"][-1] == 0.0
        with pytest.raises(
            ExcitationError, match=r"amplitude = 3: must be at most 2 A \(amplifier.continuous_current\)"
        ):
            daemon.excite("chirp", amplitude=3.0)
        with pytest.raises(ExcitationError, match=r"'chrip' is unknown"):
            daemon.excite("chrip")


def test_stop_aborts_an_experiment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        daemon.release(100.3, 30.0)
        daemon.stop()
        assert daemon.experiment()["state"] == "aborted"
        assert daemon.status()["state"] == "off"
        assert daemon.rig.core.snapshot["current"] == 0.0


def test_release_beyond_the_excursion_is_refused_before_anything_moves(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, encoder={"decimation": 217}) as (daemon, _):
        with pytest.raises(Refused, match=r"beyond safety.max_excursion = 10 rad"):
            daemon.release(100.0, None)
        assert daemon.status()["state"] == "off"


def test_hold_keeps_the_last_command_in_a_late_tick_and_fault_does_not_wait(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def script(n: int) -> int:
        if n % 50 == 0:
            time.sleep(0.004)
        return 100 + n % 7

    sections: dict[str, Any] = {"servo": {"overrun": {"policy": "hold", "fault_after": None}}}
    with daemon_on(monkeypatch, tmp_path, script, **sections) as (daemon, (device,)):
        run_for(daemon, device, 500)
        path = daemon.status()["recorder"]["path"]
        daemon.stop()
        columns = read_run(Path(path)).columns
        held = np.flatnonzero(columns["flags"] & FLAG_HELD)
        assert len(held) > 3
        current = columns["current_command_A"]
        assert (current[held[held > 0]] == current[held[held > 0] - 1]).all()
        assert (np.diff(columns["tick"])[held[held > 0] - 1] > 1).all()
    sections = {"servo": {"overrun": {"policy": "fault"}}}
    with daemon_on(monkeypatch, tmp_path, script, **sections) as (daemon, _):
        with contextlib.suppress(Refused):
            daemon.start()
        fault = wait_for_state(daemon, "fault")["fault"]
        assert fault["code"] == "overrun"
        assert "were missed, minus the punctual ticks since then; servo.overrun allows 1" in fault["cause"]


def test_status_books_energies_through_the_model(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def release() -> dict[str, Any]:
        with daemon_on(monkeypatch, tmp_path, encoder={"decimation": 217}) as (daemon, _):
            daemon.release(20.3, 1.5)
            wait_until(lambda: daemon.experiment()["state"] != "running", "the end of the release")
            return daemon.status()

    energy = undisturbed(release, lambda status: status["timing"]["missed"])["energy"]
    assert energy["estimate"] == "through the model"
    released = 0.5 * 0.012 * (20.3 * 217 * 2 * np.pi / 8192) ** 2
    assert energy["stored_at_start_J"] == pytest.approx(released, rel=0.02)
    assert energy["dissipated_J"] > 0.9 * released
    closing = energy["stored_at_start_J"] - energy["dissipated_J"] + energy["generated_J"]
    assert energy["stored_J"] == pytest.approx(
        closing + energy["settings_J"] + energy["unexplained_J"], abs=1e-9 * released
    )
    assert abs(energy["unexplained_J"]) < 0.1 * released
