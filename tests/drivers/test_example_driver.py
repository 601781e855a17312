"""The example of a third-party driver: found by its entry point, run by the servo loop in virtual time, failing safely."""

from __future__ import annotations

import math
import tomllib
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import pytest

import drivers
from drivers import DriverConfigError, PythonDriver
from hapticd.config import Config, parse_config
from hapticd.record.schema import FLAG_FAULT, FLAG_RUNNING
from hapticd.servo import atomics, faults
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters

FOLDER = Path(__file__).parents[2] / "examples" / "third_party_driver"
START = 200


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What ``pip install`` of the example's folder does: its module on the path, its entry points in the metadata."""
    project = tomllib.loads((FOLDER / "pyproject.toml").read_text())["project"]
    group = "hapticd.drivers"
    points = EntryPoints(EntryPoint(name, value, group) for name, value in project["entry-points"][group].items())
    monkeypatch.syspath_prepend(FOLDER)
    monkeypatch.setattr("drivers.registry.installed_drivers", lambda: {point.name: point for point in points})


def config(**options: Any) -> Config:
    return parse_config(
        {
            "driver": {"name": "toy_board", **options},
            "amplifier": {"bandwidth_hz": 0, "dac_bits": 0},
            "encoder": {"decimation": 7},
            "safety": {"soft_start_s": 0},
        },
        "test",
    )


def begun(driver: drivers.Driver) -> ServoCore:
    driver.open()
    core = ServoCore(driver, ring_rows=1024, excitation_rows=1)
    core.publish(parameters(driver.config, Request(state=w.RUNNING)))
    core.begin(0)
    return core


def spied(driver: drivers.Driver, monkeypatch: pytest.MonkeyPatch, fail_write_at: int = 0) -> list[tuple[float, bool]]:
    """Every command that the driver is given from now on; the one of that number fails."""
    assert isinstance(driver, PythonDriver)
    commands: list[tuple[float, bool]] = []
    write = driver.write_current

    def noted(current: float, enable: bool) -> None:
        commands.append((current, enable))
        if len(commands) == fail_write_at:
            raise OSError("the cable is out")
        write(current, enable)

    monkeypatch.setattr(driver, "write_current", noted)
    return commands


def test_it_has_at_most_forty_lines() -> None:
    assert len((FOLDER / "toy_board.py").read_text().splitlines()) <= 40


def test_discover_lists_it_with_its_summary() -> None:
    (found,) = drivers.discover()
    assert (found.name, found.latency_s, found.error) == ("toy_board", 0.0, None)
    assert found.summary.startswith("toy board")


def test_counts_and_commands_are_those_of_its_own_equations(monkeypatch: pytest.MonkeyPatch) -> None:
    cfg = config(start_counts=START)
    driver = drivers.create(cfg)
    core = begun(driver)
    commands = spied(driver, monkeypatch)
    ticks = 400
    core.run(real_time=False, ticks=ticks)
    rows = core.drain()

    raw, period = cfg.raw_resolution, cfg.period
    position, velocity, current = (START + 0.5) * raw, 0.0, 0.0
    for tick in range(ticks):
        velocity += period / 6.28e-6 * (0.0292 * current - 9.0e-6 * velocity)
        position += period * velocity
        assert rows["encoder_counts"][tick] == math.floor(position / raw)
        # The first tick asks the amplifier on and the second renders: eq. 2 with K = 0.012 N m/rad.
        current = -0.012 * 7 * raw * (rows["encoder_counts"][tick] // 7 + 0.5) / 0.0292 if tick else 0.0
        assert rows["current_command_A"][tick] == pytest.approx(current, rel=1e-12)
        current = rows["current_command_A"][tick]
    assert commands == [(command, True) for command in rows["current_command_A"]]
    assert (rows["flags"][1:] & FLAG_RUNNING != 0).all()
    assert rows["encoder_counts"].min() < 0 < rows["encoder_counts"].max(), (
        "the spring must have pulled it through the origin"
    )


def test_exception_in_read_ends_at_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    driver = drivers.create(config(start_counts=START))
    core = begun(driver)
    core.run(real_time=False, ticks=20)
    assert core.drain()["current_command_A"][-1] != 0.0

    def broken() -> int:
        raise RuntimeError("short read: 3 of 8 bytes")

    monkeypatch.setattr(driver, "read_counts", broken)
    commands = spied(driver, monkeypatch)
    core.run(real_time=False, ticks=4)
    assert_driver_error(core, driver, "RuntimeError: short read: 3 of 8 bytes")
    assert commands == [(0.0, True), (0.0, False), (0.0, False), (0.0, False)]


def test_exception_in_write_is_followed_by_zero_in_the_same_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    driver = drivers.create(config(start_counts=START))
    core = begun(driver)
    core.run(real_time=False, ticks=20)
    core.drain()
    commands = spied(driver, monkeypatch, fail_write_at=1)
    core.run(real_time=False, ticks=3)
    assert_driver_error(core, driver, "OSError: the cable is out")
    assert commands[0][0] != 0.0
    assert commands[1:] == [(0.0, True), (0.0, False), (0.0, False)]


def assert_driver_error(core: ServoCore, driver: drivers.Driver, text: str) -> None:
    assert core.load(atomics.MODE) == w.FAULT
    assert core.load(atomics.FAULT_CODE) == faults.DRIVER_ERROR
    assert driver.error == text
    rows = core.drain()
    assert (rows["flags"] & FLAG_FAULT != 0).all()
    assert (rows["current_command_A"] == 0.0).all()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (
            {"start_count": 1},
            "driver.start_count: driver toy_board has no such option; did you mean driver.start_counts?",
        ),
        ({"start_counts": 1.5}, "driver.start_counts = 1.5: must be a whole number (counts)"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_made(options: dict[str, Any], text: str) -> None:
    for refuses in (drivers.check_option_names, drivers.create):
        with pytest.raises(DriverConfigError) as caught:
            refuses(config(**options))
        assert str(caught.value) == text
