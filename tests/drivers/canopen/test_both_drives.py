"""One list of tests against two drives that share no line: `sim_hw`, and durand's responder (tests/drivers/other_drive).

Each in a process of its own, on real sockets; the drive's log is the truth. What only one of them can do stands in
``test_other_drive.py``.
"""

from __future__ import annotations

import json
import signal
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from drivers import DriverError
from drivers.interface import (
    DEVICE_FAULT,
    ERROR,
    LOST,
    MISSED,
    OK,
    STATUS_ENABLED,
    STATUS_HELD,
    X_COUNTS,
    X_CURRENT_MEASURED,
    X_DEVICE_CODE,
    X_STATUS,
)
from sim_hw.log import FAULT_INJECTED, read_log
from tests import forked
from tests.drivers.canopen.test_simulated_drive import ROOT, Steps, config, opened
from tests.polling import PATIENCE_S, wait_until

pytestmark = pytest.mark.realtime

PROGRAMS = {"ours": "sim_hw.__main__:main", "durand": "tests.drivers.other_drive.__main__:main"}
STEP_A = 58e-6 / 0.0292
SHORT_NS = 5e7
"""A period whose replies are waited for in vain."""


class Rig:
    """A drive's process, and the way to it."""

    def __init__(self, program: str, folder: Path, arguments: tuple[str, ...], script: dict[str, Any]) -> None:
        self.bus, self.log = str(folder / "bus"), folder / "truth.arrow"
        path = folder / "script.yaml"
        path.write_text(yaml.safe_dump(script))
        files = ["--socket", self.bus, "--script", str(path), "--log", str(self.log)]
        self.process = forked.Forked(program, ["canopen", *files, *arguments], ROOT)
        assert json.loads(self.process.stdout.readline())["ready"] is True

    @contextmanager
    def driven(self, **options: Any) -> Iterator[Steps]:
        """The driver, brought up and enabled at zero current."""
        with opened(config(100, interface="unix_seqpacket", channel=self.bus, **options)) as driver:
            steps = Steps(driver)
            steps.enable()
            yield steps

    def refusal(self, **options: Any) -> str:
        """Why the driver does not open."""
        settings = config(100, interface="unix_seqpacket", channel=self.bus, **options)
        with pytest.raises(DriverError) as caught, opened(settings):
            pass
        return str(caught.value)

    @contextmanager
    def third_party(self) -> Iterator[socket.socket]:
        """Another program's connection to the bus."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as other:
            other.connect(self.bus)
            other.settimeout(PATIENCE_S)
            yield other

    def injected(self) -> bool:
        """Whether the script's fault has struck."""
        return bool(np.any(read_log(self.log)["event"] == FAULT_INJECTED))

    def wait_zero(self, after: float = 0.0) -> None:
        """The drive itself says that no current flows any more, after more than ``after`` A did."""

        def ended() -> bool:
            applied = read_log(self.log)["applied_A"]
            return bool(len(applied) and applied[-1] == 0.0 and np.nanmax(applied) >= after)

        wait_until(ended, "zero current")

    def end(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(PATIENCE_S) == 0, self.process.stderr.read()


Start = Callable[..., Rig]


@pytest.fixture(params=PROGRAMS)
def start(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Start]:
    """``start(*arguments, faults=…, start=…)`` makes the drive."""
    made: list[Rig] = []

    def run(*arguments: str, **script: Any) -> Rig:
        made.append(Rig(PROGRAMS[request.param], tmp_path, arguments, script))
        return made[-1]

    yield run
    for rig in made:
        if rig.process.poll() is None:
            rig.end()
        rig.process.close()


def fault(kind: str, **keys: Any) -> dict[str, Any]:
    """A script's fault that strikes after the first enable."""
    return {"kind": kind, "at_s": 0.1, "from": "enabled", **keys}


def frame(text: str) -> bytes:
    """``struct can_frame`` of candump's notation."""
    identifier, _, data = text.partition("#")
    payload = bytes.fromhex(data)
    return struct.pack("<IB3x8s", int(identifier, 16), len(payload), payload)


def wait_for(steps: Steps, *results: int, current: Callable[[int], float] = lambda tick: 0.1) -> int:
    """Tick until a read or the error ends in one of these; nothing worse than a missed exchange may come before."""
    for tick in range(10_000):
        result = steps.tick(1, current(tick))
        if result in results:
            return result
        assert result in (OK, MISSED), steps.driver.error
    pytest.fail(f"none of {results} came")


def test_it_follows_and_stops(start: Start) -> None:
    rig = start()
    with rig.driven() as steps:
        assert "cyclic synchronous torque, 1.99 mA per step, read back" in steps.driver.describe()
        measured = steps.x.view(np.float64)
        for current in (0.3, -0.2, 0.1):
            wait_until(
                lambda wanted=current: (
                    steps.tick(1, wanted) == OK and abs(measured[X_CURRENT_MEASURED] - wanted) < 0.011
                ),
                f"{current} A",
            )
        steps.tick(0, 0.0)
        rig.wait_zero()
        wait_until(lambda: steps.tick(0) == OK and not steps.x[X_STATUS] & STATUS_ENABLED, "the amplifier off")
        steps.enable()
    rig.end()
    truth = read_log(rig.log)
    assert truth["applied_A"].max() == pytest.approx(0.3, abs=STEP_A)
    assert truth["applied_A"].min() == pytest.approx(-0.2, abs=STEP_A)
    assert truth["applied_A"][-1] == 0.0


TOLERATED = [
    fault("drop", frames="tpdo", count=1),
    fault("drop", frames="sync", count=1),
    fault("drop", frames="rpdo", count=1),
    fault("duplicate", frames="tpdo", count=5),
    fault("delay", frames="tpdo", count=1, delay_s=0.1),
    fault("reorder", frames="tpdo", count=1),
    fault("freeze_counter", duration_s=0.2),
    fault("measured_current", factor=-1),
]


@pytest.mark.parametrize("trouble", TOLERATED, ids=lambda trouble: f"{trouble['kind']} {trouble.get('frames', '')}")
def test_what_passes(start: Start, trouble: dict[str, Any]) -> None:
    rig = start(faults=[trouble])
    with rig.driven() as steps:
        steps.x.view(np.float64)[3] = SHORT_NS
        wait_until(lambda: wait_for(steps, OK) == OK and rig.injected(), "the fault")
        for _ in range(20):
            wait_for(steps, OK)
        assert steps.driver.error is None


def varying(tick: int) -> float:
    """Commands that change: only then can a drive that has lost them be told from one that follows."""
    return 0.01 * (tick % 20)


ENDS: list[tuple[dict[str, Any], tuple[int, ...], str]] = [
    (fault("drop", frames="rpdo", count=10**6), (LOST,), "node 1 does not follow its commands (RPDO 1, 0x201)"),
    (fault("corrupt", frames="tpdo", count=1), (ERROR,), "7 bytes, 8 are mapped"),
    (fault("corrupt", frames="rpdo", count=1), (DEVICE_FAULT,), "EMCY 0x8210 (protocol: a PDO of the wrong length"),
    (fault("unplug"), (LOST,), "CAN "),  # it was closed, or reset by the peer
    (fault("bus_off"), (LOST,), "bus-off: the CAN controller has left the bus"),
    (fault("reboot"), (LOST,), "node 1 rebooted: it sent its boot-up message"),
    (fault("second_node", counts=400, count=10**6), (ERROR,), "TPDO 1 of node 1 came without a SYNC"),
    (
        fault("foreign_sdo", object=0x6072, value=0x7FFF, size=2),
        (LOST,),
        "another client writes object 0x6072 of the drive (SDO to node 1)",
    ),
    (fault("foreign_sdo", object=0x6071, value=100, size=2), (LOST,), "another client writes object 0x6071"),
    *(
        (fault("emcy", code=code), (DEVICE_FAULT,), f"EMCY 0x{code:04x} ({text}")
        for code, text in (
            (0x1000, "generic"),
            (0x2310, "continuous over-current"),
            (0x3210, "over-voltage of the DC link"),
            (0x4310, "temperature of the motor too high"),
            (0x5441, ""),
            (0x6100, ""),
            (0x7305, "incremental encoder 1"),
            (0x8120, "CAN error passive"),
            (0x8611, "positioning controller: following error"),
            (0x9000, "external error"),
            (0xF001, "deceleration"),
            (0xFF01, "vendor's own"),
        )
    ),
]


@pytest.mark.parametrize(
    ("trouble", "results", "text"),
    ENDS,
    ids=[f"{one['kind']} {one.get('code', one.get('frames', ''))}" for one, *_ in ENDS],
)
def test_what_ends_it(start: Start, trouble: dict[str, Any], results: tuple[int, ...], text: str) -> None:
    rig = start(faults=[trouble])
    with rig.driven() as steps:
        result = wait_for(steps, *results, current=varying)
        assert steps.driver.error is not None
        assert text in steps.driver.error
        if trouble["kind"] == "emcy":
            assert steps.x[X_DEVICE_CODE] == trouble["code"]
        rig.wait_zero()
        if result == DEVICE_FAULT:  # it is gone with one reset, when the amplifier is asked for again
            steps.tick(0)
            steps.enable()
    rig.end()
    assert read_log(rig.log)["applied_A"][-1] == 0.0


@pytest.mark.parametrize("trouble", [fault("silent"), fault("drop", frames="tpdo", count=10**6)])
def test_silence_is_missed_for_as_long_as_it_lasts(start: Start, trouble: dict[str, Any]) -> None:
    rig = start(faults=[trouble])
    with rig.driven(watchdog_ms=10_000) as steps:
        steps.x.view(np.float64)[3] = SHORT_NS
        wait_until(lambda: steps.tick(1, 0.1) == MISSED and rig.injected(), "silence")
        assert [steps.tick(1, 0.1) for _ in range(5)] == [MISSED] * 5


def test_a_drive_that_lets_go_by_itself(start: Start) -> None:
    rig = start(faults=[fault("leave_operation_enabled")])
    with rig.driven() as steps:
        wait_until(
            lambda: wait_for(steps, OK) == OK and rig.injected() and not steps.x[X_STATUS] & STATUS_ENABLED,
            "the drive's letting go",
        )
        assert 0.0 in read_log(rig.log)["applied_A"]


SWITCH = [
    {"kind": "enable_released", "at_s": 0.0, "from": "signal"},
    {"kind": "enable_released", "at_s": 0.0, "from": "signal", "duration_s": 1e-6},
]
"""A finger at the enable switch: with the first SIGUSR1 it lets go, with the second it holds again."""


def test_the_enable_is_an_input_that_the_drive_leaves_to_the_loop(start: Start) -> None:
    rig = start(faults=SWITCH)
    with rig.driven(enable_bit=16) as steps:
        assert steps.x[X_STATUS] == STATUS_ENABLED | STATUS_HELD
        for status in (STATUS_ENABLED, STATUS_ENABLED | STATUS_HELD):
            rig.process.send_signal(signal.SIGUSR1)
            wait_until(lambda wanted=status: wait_for(steps, OK) == OK and steps.x[X_STATUS] == wanted, "the hand")


def test_a_count_that_jumps_for_one_sample_is_passed_on(start: Start) -> None:
    rig = start(faults=[fault("encoder_glitch", counts=100_000, count=1)])
    with rig.driven() as steps:
        wait_until(lambda: wait_for(steps, OK) == OK and abs(steps.x[X_COUNTS]) > 50_000, "the jump")
        wait_until(lambda: wait_for(steps, OK) == OK and abs(steps.x[X_COUNTS]) < 50_000, "its end")


def test_the_counter_wraps(start: Start) -> None:
    rig = start(start={"counts_offset": 2**31 - 1})
    with rig.driven() as steps:
        wait_until(
            lambda: wait_for(steps, OK, current=lambda _: 0.2) == OK and steps.x[X_COUNTS] > 2**31 + 50, "the wrap"
        )


def test_a_loop_that_falls_silent(start: Start) -> None:
    rig = start()
    with rig.driven(watchdog_ms=200) as steps:
        wait_for(steps, OK)
        assert steps.tick(1, 0.2) == OK
        rig.wait_zero(after=0.19)
        assert wait_for(steps, DEVICE_FAULT) == DEVICE_FAULT
        assert steps.driver.error is not None
        assert "EMCY 0x8130 (life guard or heartbeat: the drive did not hear the loop in time)" in steps.driver.error


REFUSED: list[tuple[tuple[str, ...], dict[str, Any], str]] = [
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
    (("--set", "0x6075=20"), {}, "amplifier.torque_constant is 0.0292"),
    (("--set", "0x608F:1=2048"), {}, "encoder.counts_per_rev is 8192: one of the two counts lines"),
    (("--set", "0x6072=1000"), {}, "max torque 0x6072 = 1000 ‰ clips the command at 1.99 A"),
    (("--set", "0x2110=100"), {}, "amplifier.peak_current = 6 A is 6 times the limit stored in the drive"),
    (("--set", "0x6502=4"), {"profile": "cia402"}, ""),
    (
        ("--missing", "0x60FD"),
        {"enable_bit": 16},
        "driver.enable_bit = 16: the drive, or its EDS, has no digital inputs",
    ),
    (("--missing", "0x2113"), {}, "the drive has no object 0x2113, though the EDS copley.eds has it"),
    (("--node-id", "7"), {}, "node 1 does not reply, but there is node 7: set driver.node_id = 7"),
]


@pytest.mark.parametrize(
    ("arguments", "options", "text"), REFUSED, ids=lambda one: " ".join(one) if isinstance(one, tuple) else ""
)
def test_drives_that_do_not_fit(start: Start, arguments: tuple[str, ...], options: dict[str, Any], text: str) -> None:
    assert text in start(*arguments).refusal(**options)


def test_another_device(start: Start) -> None:
    assert "node 1 is not a drive: its device type 0x1000" in start(faults=[{"kind": "wrong_version"}]).refusal()


@pytest.mark.parametrize(
    ("sent", "result", "text"),
    [
        ("080#", ERROR, "another master is on the bus: it sent SYNC (0x080)"),
        ("201#0F000000", ERROR, "another master is on the bus: it sent RPDO 1 to node 1 (0x201)"),
        ("000#0100", ERROR, "another master is on the bus: it sent NMT (0x000)"),
        ("601#2F60600001000000", LOST, "another client writes object 0x6060 of the drive"),
        ("601#2B726000FF7F0000", LOST, "another client writes object 0x6072 of the drive"),
        ("181#37022704000000FE", OK, ""),  # one forged sample a second is not told from the bus's own repeats
    ],
)
def test_a_third_party_on_the_bus(start: Start, sent: str, result: int, text: str) -> None:
    rig = start()
    with rig.driven() as steps, rig.third_party() as other:
        wait_for(steps, OK)
        other.send(frame(sent))
        assert wait_for(steps, result) == result
        assert text in (steps.driver.error or "")
        if result == LOST:
            rig.wait_zero()


def test_a_second_producer_of_sync_before_the_start(start: Start) -> None:
    rig = start()
    with rig.third_party() as other:
        ended = threading.Event()

        def produce() -> None:
            while not ended.wait(0.02):
                other.send(frame("080#"))

        thread = threading.Thread(target=produce)
        thread.start()
        try:
            assert "another master is on the bus: SYNC (0x080) was received" in rig.refusal()
        finally:
            ended.set()
            thread.join()


def test_a_drive_that_boots_while_it_is_brought_up(start: Start) -> None:
    """What was written before is lost, and nothing that is read back later shows it."""
    rig = start()
    with rig.third_party() as other:

        def boot() -> None:
            while other.recv(16)[8:11] != bytes.fromhex("2f001a"):  # the first entry of TPDO 1's mapping
                pass
            other.send(frame("701#00"))

        thread = threading.Thread(target=boot)
        thread.start()
        text = rig.refusal()
        thread.join()
    assert "node 1 booted during bring-up" in text
