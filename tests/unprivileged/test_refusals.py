"""What an ordinary user is refused: each refusal is said, with how to get it. ``python -m tests.unprivileged``."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from drivers.null import NullDriver
from hapticd.config import parse_config
from hapticd.config.paths import default_socket
from hapticd.record import RecordingError
from hapticd.record.files import open_new_run
from hapticd.record.flight import FlightRing
from hapticd.service.socket import SocketError, bind
from hapticd.servo.core import Request, parameters
from hapticd.servo.realtime import CpuLatencyRequest, lock_memory, set_scheduler
from hapticd.servo.thread import RealtimeError, ServoThread

pytestmark = pytest.mark.skipif(os.geteuid() == 0, reason="root is refused nothing: python -m tests.unprivileged")

HAPTICD = [sys.executable, "-m", "hapticd.cli"]


def test_no_real_time_priority() -> None:
    grant = set_scheduler(80)
    assert (grant.granted, grant.name) == (False, "scheduler")
    assert grant.detail == "SCHED_FIFO 80: Operation not permitted; running as an ordinary thread"
    assert "'LimitRTPRIO=80' in the unit" in grant.fix
    assert "'@haptics - rtprio 80' in /etc/security/limits.d" in grant.fix


def test_no_locked_memory() -> None:
    grant = lock_memory()
    assert (grant.granted, grant.name) == (False, "memory lock")
    assert grant.detail.startswith("memlock limit is ")
    assert "'LimitMEMLOCK=infinity' in the unit" in grant.fix


def test_no_hold_on_idle_states() -> None:
    grant = CpuLatencyRequest().acquire()
    assert (grant.granted, grant.name) == (False, "idle states")
    if Path("/dev/cpu_dma_latency").exists():
        assert grant.detail == "/dev/cpu_dma_latency: Permission denied"
        assert "60-hapticd.rules" in grant.fix
    else:
        assert "has no /dev/cpu_dma_latency" in grant.detail


def test_real_time_that_is_required_is_refused_with_all_of_it() -> None:
    config = parse_config({"servo": {"require_realtime": True}}, "test")
    driver = NullDriver(config)
    driver.open()
    servo = ServoThread(config, driver, parameters(config, Request()))
    with pytest.raises(RealtimeError) as refusal:
        servo.start()
    words = str(refusal.value)
    for name, way in (("memory lock", "LimitMEMLOCK"), ("idle states", "dma_latency"), ("scheduler", "LimitRTPRIO")):
        assert name in words
        assert way in words
    assert not servo.alive()


@pytest.mark.parametrize("place", ["/run/hapticd-of-nobody/h.sock", "/usr/h.sock"])
def test_no_folder_for_the_socket(place: str) -> None:
    with pytest.raises(SocketError) as refusal:
        bind(Path(place))
    words = str(refusal.value)
    assert words.startswith(f"cannot create the control socket {place}: Permission denied: ")
    assert f"uid {os.geteuid()} may not write to {Path(place).parent}" in words or "may not make" in words
    assert "--socket" in words
    assert "api.socket" in words


def test_the_socket_of_a_user_is_where_he_may_write(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    assert default_socket() == f"/tmp/hapticd-{os.geteuid()}/hapticd.sock"
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert default_socket() == str(tmp_path / "hapticd.sock")


def test_no_folder_for_recordings_or_the_flight_recorder() -> None:
    folder = Path("/usr/runs")
    with pytest.raises(RecordingError, match=r"cannot make record.directory /usr/runs: Permission denied"):
        open_new_run(folder, "run", "", {})
    with pytest.raises(RecordingError, match=r"no flight recorder in /usr/runs: Permission denied"):
        FlightRing.create(folder, "test", 64)


@pytest.mark.realtime
def test_the_daemon_runs_and_says_what_it_was_refused(tmp_path: Path) -> None:
    socket = tmp_path / "h.sock"
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path), "HAPTICD_SOCKET": str(socket)}
    command = [*HAPTICD, "run", "--socket", str(socket)]
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as daemon:
        try:
            said = _until(daemon, "motor ")
            status = _status(environment)
        finally:
            daemon.send_signal(signal.SIGINT)
        daemon.communicate(timeout=60)
    refused = {grant["name"]: grant["fix"] for grant in status["realtime"] if not grant["granted"]}
    assert {"scheduler", "memory lock", "idle states"} <= refused.keys()
    for name, way in refused.items():
        assert f"NO  {name}" in said
        assert f"to get it: {way}" in said


@pytest.mark.realtime
def test_the_daemon_does_not_start_where_real_time_is_required(tmp_path: Path) -> None:
    config = tmp_path / "rig.yaml"
    config.write_text("servo: {require_realtime: true}\n")
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path)}
    command = [*HAPTICD, "run", str(config), "--socket", str(tmp_path / "h.sock")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 4
    assert "servo.require_realtime is true, but memory lock: " in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "h.sock").exists()


def _until(daemon: subprocess.Popen[str], beginning: str) -> str:
    assert daemon.stdout is not None
    lines = []
    for line in daemon.stdout:
        lines.append(line)
        if beginning in line:
            break
    return "".join(lines)


def _status(environment: dict[str, str]) -> dict[str, Any]:
    done = subprocess.run([*HAPTICD, "status", "--json"], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    status: dict[str, Any] = json.loads(done.stdout)
    return status
