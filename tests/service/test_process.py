"""The daemon as a process: what the device sees when signals end it, what is left behind, and who may take over."""

from __future__ import annotations

import json
import signal
import socket
import time

import pytest

from hapticd.config import Config
from hapticd.record import read_run
from tests.polling import PATIENCE_S, wait_until
from tests.service.processes import Rig, rig

__all__ = ["rig"]

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGQUIT])
def test_signal_ends_at_zero_current(rig: Rig, number: int) -> None:
    process = rig.launch()
    rig.render()
    process.send_signal(number)
    process.wait(PATIENCE_S)
    output = rig.output.read_text()
    assert process.returncode == 0, output
    rig.check_end()
    assert not rig.socket.exists()
    for part in ("device      a test's witness", "missed periods", "late        p50", "recorded    ", "region "):
        assert part in output
    run = read_run(next((rig.folder / "runs").glob("run-*.arrow")))
    assert not run.truncated


def test_a_request_that_never_ends_does_not_keep_the_motor_alive(rig: Rig) -> None:
    """Zero current comes before the API is asked to end, which may take it a second."""
    process = rig.launch()
    rig.render()
    with socket.socket(socket.AF_UNIX) as half_sent:
        half_sent.connect(str(rig.socket))
        half_sent.sendall(b"POST /set HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\n{")
        process.terminate()
        process.wait(PATIENCE_S)
    rig.check_end()
    lines = rig.commands()
    last = max(index for index, line in enumerate(lines) if line[0] == "-")
    # With the API ended first there would be hundreds of currents and hardly a zero at the end.
    assert sum(line == "0.0 0" for line in lines[last:]) > 50


def test_a_latched_fault_ends_in_5_and_outlives_the_process(rig: Rig) -> None:
    process = rig.launch()
    rig.render()
    assert rig.command("estop", "--socket", str(rig.socket)).returncode == 0
    process.terminate()
    process.wait(PATIENCE_S)
    assert process.returncode == 5
    rig.check_end()
    rig.launch()
    status = rig.command("status", "--json", "--socket", str(rig.socket))
    assert status.returncode == 1
    assert json.loads(status.stdout)["fault"]["code"] == "estop"
    assert rig.command("start", "--socket", str(rig.socket)).returncode == 1
    assert rig.command("clear", "--socket", str(rig.socket)).returncode == 0
    assert rig.client.status()["state"] == "off"


def test_hangup_reloads_and_refuses_a_bad_config_while_it_keeps_rendering(rig: Rig) -> None:
    process = rig.launch("tests.service.on_terminal:detached")
    rig.render()
    good = rig.config.read_text()
    rig.config.write_text(good + "spring: {stiffness: 0.02}\n")
    process.send_signal(signal.SIGHUP)
    wait_until(lambda: rig.client.config()["spring"]["stiffness"] == 0.02, "the new stiffness")
    rig.config.write_text(good + "spring: {stiffnes: 0.03}\n")
    process.send_signal(signal.SIGHUP)
    refused = "reload refused, the old configuration stays in force"
    wait_until(lambda: refused in rig.output.read_text(), "the refusal")
    assert rig.client.status()["state"] == "running"
    assert rig.client.config()["spring"]["stiffness"] == 0.02
    process.terminate()
    process.wait(PATIENCE_S)
    assert "spring.stiffnes: unknown key; did you mean spring.stiffness?" in rig.output.read_text()
    rig.check_end()


def test_second_daemon_is_refused_before_it_touches_the_device(rig: Rig) -> None:
    rig.launch()
    opened = len(rig.commands())
    second = rig.command("run", str(rig.config), "--socket", str(rig.socket))
    assert second.returncode == 2
    assert f"another daemon (process {rig.processes[0].pid}) runs on {rig.socket}" in second.stderr
    assert "closed" not in rig.commands()[opened:]
    assert rig.answers()


def test_after_sigkill_the_socket_is_taken_over_and_the_recording_reads(rig: Rig) -> None:
    process = rig.launch()
    rig.render()
    wait_until(lambda: rig.client.status()["recorder"]["rows"] > 400, "recorded rows")
    rows = rig.client.status()["recorder"]["rows"]
    process.kill()
    process.wait()
    assert rig.socket.exists()
    run = read_run(next((rig.folder / "runs").glob("run-*.arrow")))
    assert len(run.columns["tick"]) >= rows - 500
    rig.launch()
    assert rig.client.status()["state"] == "off"


def test_a_freeze_below_the_heartbeats_timeout_is_a_fault_too(rig: Rig) -> None:
    process = rig.launch()
    rig.render()
    rig.client.set({"servo.overrun.fault_after": Config().servo.overrun.fault_after})
    process.send_signal(signal.SIGSTOP)
    time.sleep(0.2)
    process.send_signal(signal.SIGCONT)
    wait_until(lambda: rig.client.status()["state"] == "fault", "a fault")
    assert rig.client.status()["fault"]["code"] == "overrun"
    process.terminate()
    process.wait(PATIENCE_S)
    rig.check_end()


def test_a_frozen_daemon_faults_when_it_thaws(rig: Rig) -> None:
    process = rig.launch()
    rig.render()
    process.send_signal(signal.SIGSTOP)
    time.sleep(3.0)
    process.send_signal(signal.SIGCONT)
    wait_until(lambda: rig.client.status()["state"] == "fault", "a fault")
    status = rig.client.status()
    assert status["fault"]["code"] == "heartbeat_lost"
    assert status["timing"]["missed"] > 500


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("driver: {name: witnes}", 2, "driver.name = 'witnes': no such driver; did you mean 'witness'?"),
        ("servo: {rate_hz: 0}", 2, "servo.rate_hz = 0: must be at least 1 Hz"),
        (
            "driver: {name: loopback, speed: 3}",
            2,
            "driver.speed: driver loopback has no such option; it has: device, watchdog_ms, faults",
        ),
    ],
)
def test_a_daemon_that_cannot_start_leaves_nothing_behind(rig: Rig, text: str, code: int, message: str) -> None:
    rig.config.write_text(text + "\n")
    before = sorted(rig.folder.rglob("*"))
    refused = rig.command("run", str(rig.config), "--socket", str(rig.socket))
    assert refused.returncode == code
    assert message in refused.stderr
    assert "Traceback" not in refused.stderr
    assert sorted(rig.folder.rglob("*")) == before
