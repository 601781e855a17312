"""A producer of SYNC on the bus, which the loop follows: what is heard, what is refused, and the simulated drive as one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers import DriverConfigError, DriverError, create
from drivers.canopen import CanopenDriver, cyclic
from drivers.canopen import layout as w
from drivers.interface import ERROR, MISSED, OK, X_DEADLINE_NS, X_TIME_NS
from hapticd.config import Config
from hapticd.record.schema import FLAG_MISSED_EXCHANGE, FLAG_RUNNING
from hapticd.servo import atomics
from tests.drivers.canopen.test_exchange import ENABLED, enable
from tests.drivers.canopen.test_simulated_drive import config, opened, run, simulated_drive
from tests.drivers.canopen.wire import PERIOD_NS, Wire, frame

FAR_NS = 10**12


@pytest.fixture
def wire() -> Iterator[Wire]:
    """A drive whose power stage is on, and a loop that follows SYNC."""
    with Wire() as made:
        enable(made)
        made.s[w.FOLLOWS] = 1
        yield made


def wait(wire: Wire, *frames: str, expected_ns: int = 0, deadline_ns: int = 2**62) -> int:
    """One wait; the frames are there before."""
    for each in frames:
        wire.drive.send(frame(each))
    wire.x[X_TIME_NS], wire.x[X_DEADLINE_NS] = expected_ns, deadline_ns
    return int(cyclic.wait(wire.s, wire.x, PERIOD_NS))


def test_a_tick_begins_with_the_producers_sync_and_sends_none(wire: Wire) -> None:
    assert wait(wire, "080#", ENABLED[2:]) == OK
    assert wire.read() == OK
    assert wire.write(0.0, 1, "> 201#0F000000") == OK
    assert wait(wire, "080#01") == OK  # with the counter of 0x1019
    assert wire.read(ENABLED) == OK
    assert wire.nothing_sent()


def test_a_sample_before_its_sync_is_of_an_earlier_one(wire: Wire) -> None:
    assert wait(wire, ENABLED[2:], "080#") == OK
    assert wire.read(period_ns=2e7) == MISSED
    assert wire.s[w.STALE] == 1


def test_after_a_pause_the_last_sync_counts(wire: Wire) -> None:
    assert wait(wire, *("080#", ENABLED[2:]) * 4) == OK
    assert wire.s[w.STALE] == 3
    assert wire.read() == OK
    assert wait(wire, deadline_ns=time.monotonic_ns()) == MISSED


def test_a_sync_that_came_in_a_read_is_not_waited_for_again(wire: Wire) -> None:
    assert wait(wire, deadline_ns=time.monotonic_ns()) == MISSED
    assert wire.read("< 080#", ENABLED) == OK
    assert wait(wire, deadline_ns=time.monotonic_ns()) == MISSED


def test_no_sync_until_the_deadline(wire: Wire) -> None:
    assert wait(wire, deadline_ns=time.monotonic_ns() + 10_000_000) == MISSED


def test_two_producers_are_seen(wire: Wire) -> None:
    later = time.monotonic_ns() + FAR_NS
    for _ in range(w.SURPLUS_LIMIT - 1):
        assert wait(wire, "080#", expected_ns=later, deadline_ns=time.monotonic_ns()) == MISSED
    assert wait(wire, "080#", expected_ns=later) == OK
    assert wire.read() == ERROR
    assert wire.why is not None
    assert "two devices produce it" in wire.why


def synced(socket: str, rate_hz: float, **options: object) -> Config:
    settings = config(rate_hz, interface="unix_seqpacket", channel=socket, **options)
    return settings.model_copy(update={"servo": settings.servo.model_copy(update={"clock": "sync"})})


def test_an_interface_that_goes_through_python_is_refused() -> None:
    settings = synced("239.0.0.1", 100)
    other = settings.driver.model_copy(update={"interface": "udp_multicast"})
    with pytest.raises(
        DriverConfigError, match=r"servo.clock = sync: driver.interface = 'udp_multicast' runs through Python"
    ):
        create(settings.model_copy(update={"driver": other}))


PRODUCER = "start: {override: {0x1005: 0x40000080, 0x1006: 20000}}"


@pytest.mark.realtime
def test_the_loop_follows_the_simulated_drive(tmp_path: Path) -> None:
    script, socket = tmp_path / "script.yaml", str(tmp_path / "bus")
    script.write_text(PRODUCER)
    with (
        simulated_drive("--socket", socket, "--script", str(script)),
        opened(synced(socket, 50)) as driver,
    ):
        assert driver.check_rate(60.0) == "servo.clock = sync: the producer of SYNC sets the rate"
        core, rows = run(driver, 3.0)
        assert core.load(atomics.FAULT_CODE) == 0, driver.error
        assert np.mean(rows["flags"] & FLAG_MISSED_EXCHANGE == 0) > 0.5
        assert np.any(rows["flags"] & FLAG_RUNNING != 0)
        assert driver._block[w.UNASKED] == 0


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("script", "said"),
    [
        (PRODUCER, r"SYNC comes every \d+ µs \(.* Hz\) on average, servo.rate_hz = 100 Hz needs 10000 µs"),
        ("{}", r"no SYNC \(0x080\) is received; switch its producer on"),
    ],
)
def test_a_producer_that_does_not_fit_is_refused(tmp_path: Path, script: str, said: str) -> None:
    path, socket = tmp_path / "script.yaml", str(tmp_path / "bus")
    path.write_text(script)
    with simulated_drive("--socket", socket, "--script", str(path)):
        driver = create(synced(socket, 100))
        assert isinstance(driver, CanopenDriver)
        with pytest.raises(DriverError, match=said):
            driver.open()
        driver.close()
