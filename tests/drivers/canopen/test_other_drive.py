"""What only the drive of other hands can be made to do: refuse and delay any access, take another number, make SYNC itself.

It is served by a thread here, so that what it was asked can be looked at.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import canopen
import numpy as np
import pytest

import drivers
from drivers import DriverError
from drivers.canopen import CanopenDriver, bus
from drivers.canopen.profile import FOLDER
from drivers.interface import DEVICE_FAULT, OK, X_CURRENT_MEASURED
from tests.drivers.canopen.test_both_drives import frame
from tests.drivers.canopen.test_simulated_drive import Steps, config
from tests.drivers.other_drive import states
from tests.drivers.other_drive.drive import Drive
from tests.drivers.other_drive.wires import Hub, SlcanAdapter, Wire
from tests.polling import wait_until

pytestmark = pytest.mark.realtime

Open = Callable[..., CanopenDriver]


class Served:
    """The drive in a thread, and drivers that are brought up on it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._ended = threading.Event()
        self._made: list[CanopenDriver] = []
        self._thread: threading.Thread | None = None

    def start(self, wire: Wire | None = None, **start: Any) -> Drive:
        drive = Drive(wire or Hub(self.path), script={"start": start})
        self._thread = threading.Thread(target=lambda: drive.serve(self._ended.is_set))
        self._thread.start()
        return drive

    def open(self, **options: Any) -> CanopenDriver:
        where = {"interface": "unix_seqpacket", "channel": str(self.path)}
        driver = drivers.create(config(100, **{**where, **options}))
        assert isinstance(driver, CanopenDriver)
        self._made.append(driver)
        driver.open()
        return driver

    def refusal(self, **options: Any) -> str:
        with pytest.raises(DriverError) as caught:
            self.open(**options)
        self._made.pop().close()
        return str(caught.value)

    def end(self) -> None:
        for driver in self._made:
            driver.close()
        self._ended.set()
        if self._thread is not None:
            self._thread.join()


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    monkeypatch.setattr(bus, "LISTEN_S", 0.01)
    monkeypatch.setattr(bus, "ECHO_S", 0.01)
    made = Served(tmp_path / "bus")
    yield made
    made.end()


PARTS = 6


@pytest.mark.parametrize("part", [0, *(pytest.param(part, marks=pytest.mark.attack) for part in range(1, PARTS))])
@pytest.mark.parametrize("profile", ["copley", "cia402"])
def test_an_abort_at_each_step_of_bring_up(served: Served, profile: str, part: int) -> None:
    """Every access that a good bring-up makes, refused: named, and the drive is left where it was."""
    drive = served.start()
    served.open(profile=profile).close()  # which switches PDOs off that are off from then on
    drive.asked.clear()
    driver = served.open(profile=profile)
    asked = list(dict.fromkeys(drive.asked))
    driver.close()
    assert len(asked) > 60
    for kind, index, sub in asked[part::PARTS]:
        drive.refused[kind] = {(index, sub): 0x08000020}
        text = served.refusal(profile=profile)
        drive.refused[kind] = {}
        assert f"0x{index:04x}" in text
        assert (
            "the drive refuses: Data cannot be transferred or stored to the application (abort code 0x08000020)" in text
        )
        assert drive.state == states.OFF
        assert drive.node.nmt.state == 127
    served.open(profile=profile)


@pytest.mark.parametrize(
    ("index", "sub", "code", "text"),
    [
        (0x1A00, 3, 0x06040041, "mapping of actual current (0x221c) into TPDO 1 (0x1a00:3)"),
        (0x1A00, 0, 0x06040042, "number of objects in TPDO 1 (0x1a00)"),
        (0x1A01, 1, 0x06040041, "mapping of demand of cyclic synchronous torque (0x6074) into TPDO 2"),
        (0x1600, 2, 0x06040041, "mapping of target of cyclic synchronous torque (0x6071) into RPDO 1"),
        (0x1800, 2, 0x06090030, "transmission type of TPDO 1 (0x1800:2)"),
        (0x1802, 1, 0x06010002, "COB-ID of TPDO 3 (0x1802:1)"),
    ],
)
def test_a_mapping_that_is_refused(served: Served, index: int, sub: int, code: int, text: str) -> None:
    served.start(refuse_write={f"{index:#x}:{sub}": code})
    said = served.refusal()
    assert text in said
    assert f"abort code 0x{code:08x}" in said


def test_an_object_that_is_mapped_and_not_there(served: Served) -> None:
    """This drive takes the mapping all the same, and sends two bytes."""
    served.start(missing=["0x6063"])
    assert "reading position: the drive has no object 0x6063" in served.refusal()


def test_an_answer_that_takes_two_seconds(served: Served) -> None:
    drive = served.start(slow={"0x6060": 2.0})
    begin = time.monotonic()
    driver = served.open()
    assert time.monotonic() - begin > 4.0  # written and read back
    assert drive.asked.count(("write", 0x6060, 0)) == 1  # asked again, it would answer twice
    Steps(driver).enable()


def test_an_answer_that_does_not_come(served: Served) -> None:
    served.start(slow={"0x6060": 3600})
    assert "node 1 sent no reply for mode of operation (0x6060) within 3 s" in served.refusal()


def test_both_watchdogs(served: Served) -> None:
    """Node guarding with Copley's profile, the heartbeat consumer with the standard's."""
    drive = served.start()
    for profile in ("copley", "cia402"):
        driver = served.open(profile=profile, watchdog_ms=200)
        steps = Steps(driver)
        steps.enable()
        assert steps.tick(1, 0.2) == OK
        wait_until(lambda: drive.state == states.FAULTY, "the watchdog")
        assert steps.tick(1, 0.2) == DEVICE_FAULT
        assert "EMCY 0x8130 (life guard or heartbeat" in (driver.error or "")
        driver.close()


def test_a_drive_that_makes_sync_itself(served: Served) -> None:
    served.start(override={"0x1005": 0x40000080, "0x1006": 5000})
    assert "SYNC (0x080) was received" in (said := served.refusal())
    assert said.endswith("or switch off its SYNC production (0x1005, bit 30)")


def test_a_drive_that_is_given_another_number(served: Served) -> None:
    """By layer setting services (CiA 305), which durand has: it is another node after its next reset."""
    served.start()
    driver = served.open()
    steps = Steps(driver, period_ns=5e7)
    steps.enable()
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as other:
        other.connect(str(served.path))
        for text in ("7E5#0401000000000000", "7E5#1107000000000000", "7E5#0400000000000000", "000#8101"):
            other.send(frame(text))
    wait_until(lambda: steps.tick(1) not in (OK,), "the end of it")
    driver.close()
    assert "node 1 does not reply, but there is node 7: set driver.node_id = 7" in served.refusal()
    Steps(served.open(node_id=7)).enable()


def test_a_real_restart_while_it_is_brought_up(served: Served) -> None:
    drive = served.start()
    served.open().close()
    real = drive._takes_request

    def restart(data: bytes) -> bool:
        if data[:4] == bytes.fromhex("2f001a00"):
            drive._plan.append({"kind": "reboot", "at_s": 0.0, "off_s": 0.05})
            drive._takes_request = real
        return real(data)

    drive._takes_request = restart  # type: ignore[method-assign]
    assert "node 1 booted during bring-up" in served.refusal()


def test_slcan_over_a_pty(served: Served, tmp_path: Path) -> None:
    """python-can's serial line interface at one end, an adapter's protocol at the other: a third way to the bus."""
    line = tmp_path / "line"
    drive = served.start(wire=SlcanAdapter(line))
    driver = served.open(interface="slcan", channel=str(line), bus={"sleep_after_open": 0})
    assert driver.calls_python
    steps = Steps(driver)
    steps.enable()
    measured = steps.x.view(np.float64)
    wait_until(lambda: steps.tick(1, 0.3) == OK and measured[X_CURRENT_MEASURED] > 0.29, "the current")
    steps.tick(0)
    wait_until(lambda: drive.state == states.OFF, "the amplifier off")


def test_python_canopens_own_master_walks_it(served: Served) -> None:
    """The drive itself is checked by a third reading of the standard: python-canopen's profile of CiA 402."""
    drive = served.start()
    network = canopen.Network()
    network.connect(interface="unix_seqpacket", channel=str(served.path))
    try:
        node = canopen.BaseNode402(1, str(FOLDER / "copley.eds"))
        network.add_node(node)
        node.nmt.state = "PRE-OPERATIONAL"
        for index, sub, value in ((0x1800, 2, 1), (0x1A00, 0, 0), (0x1A00, 1, 0x60410010), (0x1A00, 0, 1)):
            (node.sdo[index][sub] if index in (0x1800, 0x1A00) else node.sdo[index]).raw = value
        for word, state in ((6, states.READY), (7, states.ON), (15, states.ENABLED), (7, states.ON), (6, states.READY)):
            node.sdo[0x6040].raw = word
            assert drive.state == state
            mask, bits = canopen.profiles.p402.State402.SW_MASK[state.upper()]
            assert node.sdo[0x6041].raw & mask == bits
        node.sdo[0x6060].raw = 10
        assert node.sdo[0x6061].raw == 10
        with pytest.raises(canopen.SdoAbortedError):
            node.sdo[0x6060].raw = 3
    finally:
        network.disconnect()
