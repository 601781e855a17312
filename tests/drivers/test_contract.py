"""What docs/reference/driver-interface.md promises of a driver, of every driver: ours, one from outside by its entry point.

A driver that is installed and has no bench here fails the first test. Ticks are counted, times are not.
"""

from __future__ import annotations

import json
import math
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import drivers
from drivers import Driver, DriverConfigError, DriverError
from drivers.interface import (
    ERROR,
    LOST,
    MISSED,
    OK,
    STATUS_ENABLED,
    X_CODE,
    X_COUNTS,
    X_CURRENT,
    X_ENABLE,
    X_PERIOD_NS,
    X_STATUS,
    X_TIME_NS,
)
from drivers.registry import installed_drivers
from hapticd.cli.main import main
from hapticd.config import Config, parse_config
from hapticd.jit import call_driver, njit
from sim_hw.log import read_log
from tests import forked
from tests.polling import wait_until
from tests.sim_hw.boards import ROOT, running_board

pytestmark = pytest.mark.realtime

EXAMPLE = ROOT / "examples" / "third_party_driver"
PERIOD_NS = 2e7
WATCHDOG_MS = 10_000
CURRENT = 0.5
"""More than dry friction holds, A."""


@njit("int64(int64, int64, int64)")
def _call(function: int, state: int, exchange: int) -> int:
    return int(call_driver(function, state, exchange))


class Ticks:
    """A driver's two functions, called as the loop does, on a grid of virtual time."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self.x = drivers.new_exchange()
        self._floats = self.x.view(np.float64)
        self._floats[X_PERIOD_NS] = PERIOD_NS
        self._step = driver.config.amplifier

    def tick(self, enable: int, current: float = 0.0) -> tuple[int, int]:
        """One read, one write: what both return."""
        driver, block = self._driver, self.x.ctypes.data
        self.x[X_TIME_NS] += int(PERIOD_NS)
        read = _call(driver.read_address, driver.state_address, block)
        self.x[X_ENABLE], self._floats[X_CURRENT] = enable, current
        self.x[X_CODE] = round(current / (self._step.dac_full_scale or 1.0) * 2 ** ((self._step.dac_bits or 1) - 1))
        return read, _call(driver.write_address, driver.state_address, block)

    @property
    def enabled(self) -> bool:
        return bool(self.x[X_STATUS] & STATUS_ENABLED)

    def enable(self) -> None:
        wait_until(lambda: self.tick(1)[0] == OK and self.enabled, "the amplifier on")


class Bench:
    """A driver's config, its device, and what the device shows of itself."""

    def __init__(self, config: Config, applied: Callable[[Driver], float], unplug: Callable[[], None] | None) -> None:
        self.config, self.applied, self.unplug = config, applied, unplug


def made(name: str, amplifier: dict[str, Any] | None = None, **options: Any) -> Config:
    document = {"driver": {"name": name, **options}, "servo": {"rate_hz": 50}, "amplifier": amplifier or {}}
    return parse_config(document, "test")


def last_applied(log: Path) -> Callable[[Driver], float]:
    def applied(_: Driver) -> float:
        rows = read_log(log)["applied_A"]
        return float(rows[-1]) if len(rows) else math.nan

    return applied


@contextmanager
def loopback(folder: Path) -> Iterator[Bench]:
    yield Bench(made("loopback"), lambda driver: math.nan, None)


@contextmanager
def toy_board(folder: Path) -> Iterator[Bench]:
    yield Bench(made("toy_board"), lambda driver: driver.current, None)  # type: ignore[attr-defined]


@contextmanager
def serial_dac(folder: Path) -> Iterator[Bench]:
    with running_board(folder) as board:
        config = made("serial_dac", port=str(board.link), watchdog_ms=WATCHDOG_MS)
        yield Bench(config, last_applied(board.log), board.process.kill)


def canopen(program: str) -> Callable[[Path], AbstractContextManager[Bench]]:
    @contextmanager
    def bench(folder: Path) -> Iterator[Bench]:
        bus, log = folder / "bus", folder / "truth.arrow"
        process = forked.Forked(program, ["canopen", "--socket", str(bus), "--log", str(log)], ROOT)
        try:
            assert json.loads(process.stdout.readline())["ready"] is True
            options = {"interface": "unix_seqpacket", "channel": str(bus), "watchdog_ms": WATCHDOG_MS}
            yield Bench(made("canopen", {"dac_bits": 0}, **options), last_applied(log), process.kill)
        finally:
            process.close()

    return bench


BENCHES = {
    "loopback": loopback,
    "toy_board": toy_board,
    "serial_dac": serial_dac,
    "canopen": canopen("sim_hw.__main__:main"),
    "canopen on a drive of other hands": canopen("tests.drivers.other_drive.__main__:main"),
}


@pytest.fixture(autouse=True)
def _example_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example beside what is installed, as ``pip install`` of its folder has it."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    group = "hapticd.drivers"
    points = EntryPoints(EntryPoint(name, value, group) for name, value in project["entry-points"][group].items())
    installed = {**installed_drivers(), **{point.name: point for point in points}}
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.setattr("drivers.registry.installed_drivers", lambda: installed)


@pytest.fixture(params=BENCHES)
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bench]:
    with BENCHES[request.param](tmp_path) as ready:
        yield ready


@pytest.fixture
def driver(bench: Bench) -> Iterator[Driver]:
    opened = drivers.create(bench.config)
    opened.open()
    yield opened
    opened.close()


def test_every_driver_has_its_bench() -> None:
    assert {found.name for found in drivers.discover()} == {name.partition(" ")[0] for name in BENCHES}
    for found in drivers.discover():
        assert found.error is None
        assert found.summary


def test_life(bench: Bench) -> None:
    driver = drivers.create(bench.config)
    driver.close()  # never opened
    driver = drivers.create(bench.config)
    assert (driver.read_address, driver.write_address) == (0, 0)
    assert driver.latency_s == drivers.declared_latency(bench.config)[0]
    driver.open()
    assert driver.read_address and driver.write_address  # noqa: PT018
    assert driver.describe()
    assert driver.error is None
    assert driver.check_rate(50) is None
    ticks = Ticks(driver)
    assert ticks.tick(0) in ((OK, OK), (MISSED, OK))
    assert not ticks.enabled
    driver.close()
    driver.close()
    again = drivers.create(bench.config)
    again.open()
    Ticks(again).enable()
    again.close()


def test_zero_at_disable_and_at_close(bench: Bench, driver: Driver) -> None:
    ticks = Ticks(driver)
    for end in (lambda: ticks.tick(0), driver.close):
        ticks.enable()
        wait_until(lambda: ticks.tick(1, CURRENT) == (OK, OK) and not abs(bench.applied(driver)) < 0.4, "the current")
        end()
        wait_until(lambda: not abs(bench.applied(driver)) > 0.0, "zero current")


def test_a_command_moves_the_very_next_sample(driver: Driver) -> None:
    """No hidden period: latency is declared in s, and is less than one period of this length."""
    assert driver.latency_s < 1e-9 * PERIOD_NS
    ticks = Ticks(driver)
    ticks.enable()
    for _ in range(5):  # a busy machine loses an exchange now and then
        before = int(ticks.x[X_COUNTS])
        pushed = ticks.tick(1, CURRENT)
        time.sleep(1e-9 * PERIOD_NS)  # a device of its own moves in its own time
        seen = ticks.tick(1, CURRENT)
        if pushed == seen == (OK, OK):
            assert ticks.x[X_COUNTS] > before + 10
            return
    pytest.fail("no two exchanges in a row were whole")


def test_an_unplugged_device_is_told_in_words(bench: Bench, driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = Ticks(driver)
    ticks.enable()
    if bench.unplug is not None:
        bench.unplug()
    elif isinstance(driver, drivers.PythonDriver):

        def gone() -> int:
            raise OSError("the cable is out")

        monkeypatch.setattr(driver, "read_counts", gone)
    else:
        pytest.skip("has no cable")
    results: list[int] = []
    wait_until(lambda: results.append(ticks.tick(1, CURRENT)[0]) or results[-1] in (ERROR, LOST), "the loss")
    assert driver.error or results[-1] == LOST  # an error has words; of a lost device the fault's own say enough
    for _ in range(3):  # the loop goes on calling
        assert ticks.tick(0)[0] in (ERROR, LOST)
    driver.close()


def test_an_unknown_option_is_refused_by_check_too(
    bench: Bench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = bench.config.driver.name
    options = {**bench.config.driver.options, "latncy_s": 0.1}
    wrong = made(name, {"dac_bits": bench.config.amplifier.dac_bits}, **options)
    for refuses in (drivers.create, drivers.check_option_names):
        with pytest.raises(DriverConfigError, match=f"driver.latncy_s: driver {name} has no such option"):
            refuses(wrong)
    path = tmp_path / "rig.yaml"
    path.write_text(json.dumps({"driver": {"name": name, **options}}))
    assert main(["check", str(path)]) == 2
    assert f"driver.latncy_s: driver {name} has no such option" in capsys.readouterr().err


def test_a_device_that_is_not_there(bench: Bench, tmp_path: Path) -> None:
    where = {"serial_dac": "port", "canopen": "channel"}.get(bench.config.driver.name)
    if where is None:
        pytest.skip("is always there")
    options = {**bench.config.driver.options, where: str(tmp_path / "nobody")}
    driver = drivers.create(made(bench.config.driver.name, {"dac_bits": bench.config.amplifier.dac_bits}, **options))
    with pytest.raises(DriverError, match="nobody"):
        driver.open()
    driver.close()
