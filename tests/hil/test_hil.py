"""The daemon on simulated hardware in a process of its own, over each transport, and some faults of the matrix.

Times are not asserted, but for bounds that only a broken safety path exceeds; `hapticd hil --fault-matrix` measures them.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.config import Config, apply_settings, parse_config
from hapticd.hil import delay
from hapticd.hil.cases import FIG_8
from hapticd.hil.clock import JumpingClock
from hapticd.hil.device import Device
from hapticd.hil.device_log import COMMAND, FAULT_INJECTED, SAMPLE, DeviceLog
from hapticd.hil.errors import HilError
from hapticd.hil.injections import INJECTIONS
from hapticd.hil.matrix import detection_s, run_injection, run_matrix, with_current
from hapticd.hil.suite import run_suite
from hapticd.record import read_run
from hapticd.stability.guard import judge
from tests.polling import multicast_group, wait_until

pytestmark = pytest.mark.realtime

WATCHDOG_MS = 400
"""So long that a busy machine does not end a run; far below the bound that the tests set."""
TRANSPORTS: dict[str, dict[str, Any]] = {
    "serial board on a pty": {"name": "serial_dac", "port": "/dev/null", "watchdog_ms": WATCHDOG_MS},
    "CAN frames over a Unix socket": {
        "name": "canopen",
        "interface": "unix_seqpacket",
        "channel": "-",
        "watchdog_ms": WATCHDOG_MS,
    },
    "CAN over udp_multicast": {
        "name": "canopen",
        "interface": "udp_multicast",
        "channel": multicast_group(),
        "watchdog_ms": WATCHDOG_MS,
    },
}


def config(driver: dict[str, Any], rate_hz: float = 200.0) -> Config:
    document = {
        "driver": driver,
        "servo": {"rate_hz": rate_hz, "overrun": {"fault_after": None}},
        "safety": {"missed_exchanges": 10, "heartbeat_timeout_s": 10},
    }
    return parse_config(document, "test")


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_case_c_stops_as_simulated(transport: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    if not transport.startswith("serial"):  # one of them is started as a user does
        request.getfixturevalue("forked")
    (case_c,) = [case for case in FIG_8 if case.name == "c"]
    result = run_suite(config(TRANSPORTS[transport]), cases=[case_c], with_excitation=False, keep=tmp_path / "kept")
    (case,) = result.cases
    assert (tmp_path / "kept" / "device.arrow").exists()
    if case.report["disturbances"]:
        pytest.skip(f"this machine disturbed each of {case.report['attempts']} runs: no statement")
    assert case.report["outcome"] == "decaying"
    assert abs(case.report["final_ticks"]) <= 1.0  # within the band in which stiction holds: sigma is 1
    assert case.report["achieved_deflection"] == pytest.approx(2.3, abs=0.5 / 217)
    assert len(result.latency_s) > 50
    assert float(np.median(result.latency_s)) < 0.005


@pytest.mark.usefixtures("forked")
def test_case_d_grows_although_the_guard_would_refuse_it(tmp_path: Path) -> None:
    (case_d,) = [case for case in FIG_8 if case.name == "d"]
    rig = config(TRANSPORTS["serial board on a pty"])
    refused = judge(apply_settings(rig, case_d.settings, source="test"), 0.0, deflection=case_d.deflection)
    assert refused.verdict == "refused"
    (case,) = run_suite(rig, cases=[case_d], with_excitation=False, keep=tmp_path / "kept").cases
    run = read_run(next((tmp_path / "kept" / "runs").glob("*-release.arrow")))
    assert (run.metadata["guard"]["verdict"], run.metadata["guard"]["force"]) == ("forced", True)
    if case.report["disturbances"]:
        pytest.skip(f"this machine disturbed each of {case.report['attempts']} runs: no statement")
    assert case.report["outcome"] == "growing"


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize(
    ("transport", "name"),
    [
        ("serial board on a pty", "sigkill"),
        ("serial board on a pty", "unplug"),
        ("CAN frames over a Unix socket", "sigkill"),
        ("CAN frames over a Unix socket", "drop_replies"),
        ("CAN frames over a Unix socket", "encoder_glitch"),
        ("CAN frames over a Unix socket", "second_node"),
        ("CAN frames over a Unix socket", "foreign_write"),
    ],
)
def test_a_fault_ends_the_current(transport: str, name: str, tmp_path: Path) -> None:
    (injection,) = [one for one in INJECTIONS if one.name == name]
    try:
        row = run_injection(with_current(config(TRANSPORTS[transport])), injection, tmp_path)
    except HilError as error:
        if "this machine is too busy" not in str(error):
            raise
        pytest.skip(str(error))
    assert row.zero_after_s is not None
    assert row.zero_after_s < 0.7
    assert row.code in injection.codes or not injection.codes


@pytest.mark.usefixtures("forked")
def test_a_device_of_another_version_is_refused(tmp_path: Path) -> None:
    (injection,) = [one for one in INJECTIONS if one.name == "wrong_version"]
    row = run_injection(config(TRANSPORTS["serial board on a pty"]), injection, tmp_path)
    assert row.met
    assert "version" in row.cause


def test_a_driver_inside_the_daemon_has_no_device() -> None:
    with pytest.raises(HilError, match="hil needs serial_dac or canopen"):
        run_suite(config({"name": "loopback"}))


@pytest.mark.parametrize(("tolerated", "rate_hz", "limit_s"), [(2, 1000.0, 0.004), (2, 200.0, 0.02), (0, 500.0, 0.004)])
def test_the_matrixs_limit_follows_from_the_config(tolerated: int, rate_hz: float, limit_s: float) -> None:
    rig = parse_config({"safety": {"missed_exchanges": tolerated}, "servo": {"rate_hz": rate_hz}}, "test")
    assert detection_s(rig) == pytest.approx(limit_s)


def test_no_matrix_without_a_device() -> None:
    with pytest.raises(HilError, match="hil needs serial_dac or canopen"):
        run_matrix(config({"name": "loopback"}))


@pytest.mark.parametrize(
    ("interface", "channel"), [("socketcan", "can0"), ("socketcan", "vcan99"), ("slcan", "/dev/ttyACM0")]
)
def test_a_bus_with_a_real_drive_on_it_is_refused(interface: str, channel: str, tmp_path: Path) -> None:
    driver = {"name": "canopen", "interface": interface, "channel": channel}
    with pytest.raises(HilError, match="a real drive may be there"):
        Device(config(driver), tmp_path)


def test_a_virtual_can_interface_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = tmp_path / "devices" / "virtual" / "net" / "vcan0"
    kernel.mkdir(parents=True)
    (tmp_path / "net").mkdir()
    (tmp_path / "net" / "vcan0").symlink_to(kernel)
    monkeypatch.setattr("hapticd.hil.device.SYS_CLASS_NET", tmp_path / "net")
    Device(config({"name": "canopen", "interface": "socketcan", "channel": "vcan0"}), tmp_path / "work")


def test_a_child_ends_with_its_parent_however_that_ends(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    child = f"import os, pathlib, time; pathlib.Path({str(pid_file)!r}).write_text(str(os.getpid())); time.sleep(300)"
    parent = (
        "import pathlib, sys, time\n"
        "from hapticd.hil.process import Child\n"
        f"with Child('a child', [sys.executable, '-c', {child!r}], pathlib.Path({str(tmp_path / 'out')!r})):\n"
        "    time.sleep(300)\n"
    )
    with subprocess.Popen([sys.executable, "-c", parent]) as process:
        wait_until(lambda: pid_file.exists() and pid_file.read_text() != "", "the child")
        process.kill()
    stat = Path("/proc") / pid_file.read_text() / "stat"
    wait_until(lambda: not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] in "ZX", "the child's end")


def test_a_compiler_that_fails_is_told_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = tmp_path / "cc"
    compiler.write_text("#!/bin/sh\necho '<stdin>:3:10: fatal error: fcntl.h: No such file or directory' >&2\nexit 1\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(HilError, match=r"exit code 1.*libc6-dev.*fatal error: fcntl\.h: No such file"):
        JumpingClock(tmp_path)


def test_bus_arguments_reach_the_device(tmp_path: Path) -> None:
    driver = {**TRANSPORTS["CAN over udp_multicast"], "bus": {"port": 44_001, "fd": False}}
    words = Device(config(driver), tmp_path).command
    assert words[words.index("--bus") :][:4] == ["--bus", "port=44001", "--bus", "fd=false"]


@pytest.mark.parametrize(
    ("delays_us", "realtime", "said"),
    [
        ([100, 150, 300], True, "within the declared delay: the median is 50 µs below it; 33.3 % of the commands took"),
        ([250, 260, 270], True, "above the declared delay: the median by 60 µs (30 %); put driver.latency_s: 0.00026"),
        ([100], False, "This kernel is not a real-time one"),
    ],
)
def test_the_delay_is_judged(delays_us: list[int], realtime: bool, said: str) -> None:
    found = delay.measured(1e-6 * np.array(delays_us, float), 200e-6)
    assert found is not None
    text = delay.verdict(found, realtime)
    assert said in text
    assert ("real-time" in text) is not realtime


def test_no_delay_no_verdict() -> None:
    assert delay.measured(np.zeros(0), 2e-4) is None
    assert delay.document(None, 2e-4, True)["within_declared"] is None


def log(rows: list[tuple[int, int, float]]) -> DeviceLog:
    time_ns, event, applied = (np.array(column) for column in zip(*rows, strict=True))
    return DeviceLog(time_ns, event, applied, applied, np.zeros(len(rows)))


def test_the_current_is_zero_only_when_it_stays_so() -> None:
    rows = [(0, COMMAND, 0.1), (10, FAULT_INJECTED, 0.1), (20, COMMAND, 0.0), (30, COMMAND, 0.1), (40, COMMAND, 0.0)]
    found = log(rows)
    assert found.injected_ns() == 10
    assert found.zero_current_after(10) == 40
    assert log(rows[:4]).zero_current_after(10) is None
    assert found.until(35).zero_current_after(10) is None
    assert found.flows_at(10)
    assert not found.flows_at(25)
    assert not found.flows_at(0)
    assert log([(0, COMMAND, 0.0), (5, SAMPLE, 0.0)]).zero_current_after(3) == 3


def test_the_delay_is_from_a_sample_to_its_own_command() -> None:
    rows = [(0, SAMPLE, 0.0), (50_000, COMMAND, 0.0), (1_000_000, SAMPLE, 0.0), (2_000_000, SAMPLE, 0.0)]
    assert log([*rows, (2_030_000, COMMAND, 0.0), (2_040_000, COMMAND, 0.0)]).sample_to_current_s() == pytest.approx(
        [50e-6, 30e-6]
    )
