"""The driver against the simulated drive in its own process: real sockets, real time, the drive's log as the truth."""

from __future__ import annotations

import itertools
import json
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import drivers
from drivers import DriverError
from drivers.canopen import CanopenDriver
from drivers.canopen.profile import FOLDER
from drivers.interface import (
    DEVICE_FAULT,
    ERROR,
    LOST,
    OK,
    STATUS_ENABLED,
    X_CURRENT,
    X_CURRENT_MEASURED,
    X_DEVICE_CODE,
    X_ENABLE,
    X_STATUS,
)
from hapticd.config import Config, parse_config
from hapticd.jit import call_driver, njit
from hapticd.record.schema import FLAG_MISSED_EXCHANGE, FLAG_RUNNING
from hapticd.servo import atomics, faults
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters
from sim_hw.canopen.dictionary import EDS
from sim_hw.log import COMMAND, DISABLE, FAULT_INJECTED, SAMPLE, read_log
from tests import forked
from tests.polling import PATIENCE_S, multicast_group, wait_until

pytestmark = pytest.mark.realtime

ROOT = Path(__file__).parents[3]
WATCHDOG_MS = 1000
"""So long that only a loop that really hangs is taken for one."""
ORIGIN_RAD = 0.3
"""Far from where the shaft rests, so that there is a current at once."""


@contextmanager
def simulated_drive(*arguments: str) -> Iterator[None]:
    """The drive's process, ready to be spoken to."""
    process = forked.device(["canopen", *arguments], ROOT)
    try:
        assert json.loads(process.stdout.readline())["ready"] is True
        yield
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
    finally:
        process.close()


def config(rate_hz: float, **options: Any) -> Config:
    return parse_config(
        {
            "driver": {"name": "canopen", "watchdog_ms": WATCHDOG_MS, **options},
            "servo": {"rate_hz": rate_hz, "overrun": {"fault_after": 0}},
            "spring": {"origin": ORIGIN_RAD},
            "amplifier": {"dac_bits": 0},
            "safety": {"missed_exchanges": 200, "heartbeat_timeout_s": 10},
        },
        "test",
    )


@contextmanager
def opened(settings: Config) -> Iterator[CanopenDriver]:
    driver = drivers.create(settings)
    assert isinstance(driver, CanopenDriver)
    try:
        driver.open()
        yield driver
    finally:
        driver.close()


def run(driver: CanopenDriver, seconds: float) -> tuple[ServoCore, Any]:
    """The servo loop in real time for that long; the core and its rows."""
    core = ServoCore(driver, ring_rows=1 << 15, excitation_rows=1)
    core.publish(parameters(driver.config, Request(state=w.RUNNING)))
    core.begin(time.monotonic_ns() + 1_000_000)
    core.store(atomics.HEARTBEAT_NS, time.monotonic_ns())
    thread = threading.Thread(target=lambda: core.run(real_time=True, ticks=0))
    thread.start()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        core.store(atomics.HEARTBEAT_NS, time.monotonic_ns())
        time.sleep(0.02)
    core.store(atomics.STOP, 1)
    thread.join()
    return core, core.drain()


@njit("int64(int64, int64, int64)")
def _call(function: int, state: int, exchange: int) -> int:
    return int(call_driver(function, state, exchange))


class Steps:
    """Single ticks, by hand."""

    def __init__(self, driver: CanopenDriver, period_ns: float = 5e8) -> None:
        self.driver = driver
        self.x = drivers.new_exchange()
        self.x.view(np.float64)[3] = period_ns

    def tick(self, enable: int, current: float = 0.0) -> int:
        read = _call(self.driver.read_address, self.driver.state_address, self.x.ctypes.data)
        self.x[X_ENABLE], self.x.view(np.float64)[X_CURRENT] = enable, current
        _call(self.driver.write_address, self.driver.state_address, self.x.ctypes.data)
        return read

    def enable(self) -> None:
        wait_until(lambda: self.tick(1) == OK and self.x[X_STATUS] & STATUS_ENABLED, "the amplifier on")


def test_compiled_loop_at_1_khz_pulls_the_shaft_to_the_origin(tmp_path: Path) -> None:
    socket, log = str(tmp_path / "bus"), tmp_path / "truth.arrow"
    with (
        simulated_drive("--socket", socket, "--log", str(log)),
        opened(config(1000, interface="unix_seqpacket", channel=socket)) as driver,
    ):
        core, rows = run(driver, 3.0)
    assert (core.load(atomics.FAULT_CODE), driver.error) == (faults.NONE, None)
    running = rows[rows["flags"] & FLAG_RUNNING != 0]
    assert len(running) > 300
    assert np.mean(running["flags"] & FLAG_MISSED_EXCHANGE != 0) < 0.5
    assert running["encoder_counts"][-1] == pytest.approx(ORIGIN_RAD / (2 * np.pi / 8192), rel=0.5)
    truth = read_log(log)
    step = 58e-6 / 0.0292
    commanded = set(np.round(running["current_command_A"] / step).astype(int))
    decoded = {round(value / step) for value in truth["command_A"] if np.isfinite(value)}
    assert decoded - {0} <= commanded
    assert len(decoded) > 10
    assert truth["applied_A"][-1] == 0.0


def test_loop_through_python_at_200_hz(tmp_path: Path) -> None:
    channel = multicast_group()
    with (
        simulated_drive("--interface", "udp_multicast", "--channel", channel),
        opened(config(200, interface="udp_multicast", channel=channel)) as driver,
    ):
        assert driver.calls_python
        core, rows = run(driver, 2.0)
    assert (core.load(atomics.FAULT_CODE), driver.error) == (faults.NONE, None)
    assert np.count_nonzero(rows["flags"] & FLAG_RUNNING) > 50
    assert rows["encoder_counts"][-1] > 0


def test_programmed_current(tmp_path: Path) -> None:
    socket = str(tmp_path / "bus")
    with (
        simulated_drive("--socket", socket, "--no-cst"),
        opened(config(1000, interface="unix_seqpacket", channel=socket)) as driver,
    ):
        assert "programmed current, 10 mA per step" in driver.describe()
        _, rows = run(driver, 1.0)
        assert np.nanmax(np.abs(rows["current_measured_A"])) > 0.02
        assert rows["encoder_counts"][-1] > 0


def test_a_loop_that_hangs_is_noticed_by_the_drive_and_reset_by_the_next_open(tmp_path: Path) -> None:
    socket = str(tmp_path / "bus")
    settings = config(1000, interface="unix_seqpacket", channel=socket)
    with simulated_drive("--socket", socket):
        with opened(settings) as driver:
            steps = Steps(driver)
            steps.enable()
            time.sleep(1.5e-3 * WATCHDOG_MS)
            assert steps.tick(1) == DEVICE_FAULT
            assert steps.x[X_DEVICE_CODE] == 0x8130
            assert driver.error is not None
            assert "EMCY 0x8130 (life guard or heartbeat: the drive did not hear the loop in time)" in driver.error
        with opened(settings) as driver:
            Steps(driver).enable()


@pytest.mark.parametrize(
    ("fault", "result", "why"),
    [
        ({"kind": "reboot"}, LOST, "node 1 rebooted"),
        ({"kind": "emcy", "code": 0x2310}, DEVICE_FAULT, "EMCY 0x2310 (continuous over-current)"),
        (
            {"kind": "second_node", "counts": 400, "count": 9},
            ERROR,
            "TPDO 1 of node 1 came without a SYNC",
        ),
        (
            {"kind": "foreign_sdo", "object": 0x6072, "value": 0x7FFF, "size": 2},
            LOST,
            "another client writes object 0x6072 of the drive (SDO to node 1)",
        ),
    ],
)
def test_faults_of_the_drive(tmp_path: Path, fault: dict[str, Any], result: int, why: str) -> None:
    socket, script = str(tmp_path / "bus"), tmp_path / "script.yaml"
    script.write_text(yaml.safe_dump({"faults": [{**fault, "at_s": 0.1, "from": "enabled"}]}))
    with (
        simulated_drive("--socket", socket, "--script", str(script)),
        opened(config(1000, interface="unix_seqpacket", channel=socket)) as driver,
    ):
        steps = Steps(driver)
        steps.enable()
        wait_until(lambda: steps.tick(1) == result, f"result {result}")
        assert driver.error is not None
        assert why in driver.error


@pytest.mark.parametrize(
    ("write", "why"),
    [
        (bytes.fromhex("2f60600003000000"), "object 0x6060"),  # refused by the drive, but somebody tries
        (bytes.fromhex("2b726000ff7f0000"), "object 0x6072"),
    ],
)
def test_a_second_program_on_the_bus_that_writes(tmp_path: Path, write: bytes, why: str) -> None:
    bus, log = str(tmp_path / "bus"), tmp_path / "truth.arrow"
    with (
        simulated_drive("--socket", bus, "--log", str(log)),
        opened(config(1000, interface="unix_seqpacket", channel=bus)) as driver,
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as other,
    ):
        steps = Steps(driver)
        steps.enable()
        assert steps.tick(1, 0.3) == OK
        other.connect(bus)
        other.send(struct.pack("<IB3x8s", 0x601, 8, bytes.fromhex("4061600000000000")))  # reads, which is no harm
        wait_until(lambda: steps.tick(1, 0.3) == OK and driver.remarks(), "the read to be counted")
        other.send(struct.pack("<IB3x8s", 0x601, 8, write))
        wait_until(lambda: steps.tick(1, 0.3) == LOST, "the write to be noticed")
        assert driver.error is not None
        assert driver.error.startswith(f"another client writes {why} of the drive")
        wait_until(lambda: read_log(log)["applied_A"][-1] == 0.0, "zero current")
    truth = read_log(log)
    assert truth["applied_A"].max() > 0.2


@pytest.mark.parametrize("actual", [(0x221C, "centiampere"), (0x6077, "permille_rated_torque")])
def test_the_measured_current_is_that_of_the_command_before(tmp_path: Path, actual: tuple[int, str]) -> None:
    """Of each SYNC: what flowed when it came, in A, with the command's sign."""
    bus, profile = str(tmp_path / "bus"), tmp_path / "mine.yaml"
    index, unit = actual
    stock = yaml.safe_load((FOLDER / "copley.yaml").read_text())
    profile.write_text(yaml.safe_dump({**stock, "actual": {"object": index, "unit": unit}}))
    options = {"profile": str(profile), "eds": str(FOLDER / "copley.eds")}
    with (
        simulated_drive("--socket", bus),
        opened(config(1000, interface="unix_seqpacket", channel=bus, **options)) as driver,
    ):
        steps = Steps(driver)
        steps.enable()
        told = []
        commands = (0.3, -0.2, 0.1, 0.0)
        for current in commands:
            assert steps.tick(1, current) == OK
            time.sleep(0.005)  # the amplifier's lag is 0.1 ms
            assert steps.tick(1, current) == OK
            told.append(float(steps.x.view(np.float64)[X_CURRENT_MEASURED]))
    assert told == pytest.approx(commands, abs=0.011)


@pytest.mark.parametrize(
    ("lie", "told"),
    [({"factor": -1}, -0.3), ({"factor": 0}, 0.0), ({"factor": 0, "current": 30.0}, 30.0)],
)
def test_a_drive_that_lies_about_its_current_is_passed_on_as_it_says(
    tmp_path: Path, lie: dict[str, float], told: float
) -> None:
    bus, script = str(tmp_path / "bus"), tmp_path / "script.yaml"
    script.write_text(yaml.safe_dump({"faults": [{"kind": "measured_current", "at_s": 0.1, "from": "enabled", **lie}]}))
    with (
        simulated_drive("--socket", bus, "--script", str(script)),
        opened(config(1000, interface="unix_seqpacket", channel=bus)) as driver,
    ):
        steps = Steps(driver)
        steps.enable()
        measured = steps.x.view(np.float64)
        wait_until(
            lambda: steps.tick(1, 0.3) == OK and abs(measured[X_CURRENT_MEASURED] - told) < 0.011,
            f"{told} A to be told",
        )


@pytest.mark.parametrize(
    ("arguments", "options", "text"),
    [
        (("--missing", "0x2113"), {}, "the drive has no object 0x2113, though the EDS copley.eds has it"),
        (("--set", "0x6076=0"), {}, "rated torque 0x6076 is 0"),
        (
            ("--missing", "0x6075", "--set", "0x6076=6"),
            {},
            "6 cN m would be 2.05 A, so the drive's unit is most likely cN m",
        ),
        (
            ("--missing", "0x6075", "--set", "0x6076=58400"),
            {},
            "58400 µN m would be 2 A, so the drive's unit is most likely µN m",
        ),
        (("--set", "0x608F:1=2048"), {}, "encoder.counts_per_rev is 8192: one of the two counts lines"),
        (("--set", "0x6072=1000"), {}, "max torque 0x6072 = 1000 ‰ clips the command at 1.99 A"),
        (("--node-id", "7"), {}, "node 1 does not reply, but there is node 7: set driver.node_id = 7"),
        ((), {"profile": "cia402"}, "consumer heartbeat time: the drive has no object 0x1016:1"),
    ],
)
def test_drives_that_do_not_fit(tmp_path: Path, arguments: tuple[str, ...], options: dict[str, Any], text: str) -> None:
    socket = str(tmp_path / "bus")
    settings = config(1000, interface="unix_seqpacket", channel=socket, **options)
    with (
        simulated_drive("--socket", socket, *arguments),
        pytest.raises(DriverError) as caught,
        opened(settings),
    ):
        pass
    assert text in str(caught.value)


def deaf(tmp_path: Path, current: Callable[[int], float], **options: Any) -> tuple[str, Any]:
    """A drive that loses every RPDO from 0.3 s on, and what the driver and the drive's log say at the end."""
    socket, script, log = str(tmp_path / "bus"), tmp_path / "script.yaml", tmp_path / "truth.arrow"
    fault = {"kind": "drop", "frames": "rpdo", "count": 1_000_000, "at_s": 0.3, "from": "enabled"}
    script.write_text(yaml.safe_dump({"faults": [fault]}))
    with (
        simulated_drive("--socket", socket, "--script", str(script), "--log", str(log)),
        opened(config(1000, interface="unix_seqpacket", channel=socket, **options)) as driver,
    ):
        steps = Steps(driver)
        steps.enable()
        tick = itertools.count()
        wait_until(lambda: steps.tick(1, current(next(tick))) in (LOST, DEVICE_FAULT), "the fault")
        said = driver.error or ""
        wait_until(lambda: read_log(log)["applied_A"][-1] == 0.0, "zero current")
    return said, read_log(log)


def test_a_drive_that_hears_everything_but_its_commands_is_stopped(tmp_path: Path) -> None:
    said, truth = deaf(tmp_path, lambda n: 0.01 * (n % 20))
    assert said.startswith("node 1 does not follow its commands (RPDO 1, 0x201): in 3 samples in a row")
    first_lost = truth["time_ns"][truth["event"] == FAULT_INJECTED][0]
    samples = truth["time_ns"][(truth["event"] == SAMPLE) & (truth["time_ns"] > first_lost)]
    zero = truth["time_ns"][(truth["time_ns"] > first_lost) & (truth["applied_A"] == 0.0)][0]
    assert np.count_nonzero(samples < zero) <= 6  # and the current ends with the tick in which the third one told


def test_a_drive_that_watches_rpdo_1_ends_a_current_that_does_not_change(tmp_path: Path) -> None:
    said, truth = deaf(tmp_path, lambda n: 0.1, eds=str(EDS))
    assert "EMCY 0x8250 (RPDO time-out: the drive did not hear the loop's commands in time)" in said
    last = truth["time_ns"][truth["event"] == COMMAND][-1]
    assert truth["time_ns"][truth["event"] == DISABLE][0] - last == WATCHDOG_MS * 1_000_000
