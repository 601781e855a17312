"""The enable that a person holds, on CAN: a bit of 0x60FD in TPDO 2, without which a sample is none."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from drivers import DriverConfigError, DriverError, create
from drivers.canopen import layout as w
from drivers.interface import MISSED, OK, STATUS_ENABLED, STATUS_HELD, X_STATUS
from tests.drivers.canopen.test_bring_up import Bench, bench
from tests.drivers.canopen.test_exchange import ENABLED, enable
from tests.drivers.canopen.test_simulated_drive import config
from tests.drivers.canopen.wire import Wire

__all__ = ["bench"]
HELD, RELEASED = "< 281#00000100", "< 281#FFFFFEFF"
"""Bit 16 of the inputs alone, and all others."""


@pytest.fixture
def wire() -> Iterator[Wire]:
    """A drive whose power stage is on, and whose inputs alone come in TPDO 2."""
    with Wire() as made:
        enable(made)
        made.s[w.HELD_MASK] = 1 << 16
        yield made


def test_the_bit_is_the_status(wire: Wire) -> None:
    assert wire.read("> 080#", ENABLED, HELD) == OK
    assert wire.x[X_STATUS] == STATUS_ENABLED | STATUS_HELD
    assert wire.read("> 080#", RELEASED, ENABLED) == OK
    assert wire.x[X_STATUS] == STATUS_ENABLED


def test_a_sample_without_the_inputs_is_none(wire: Wire) -> None:
    """What the last SYNC brought says nothing of this one."""
    assert wire.read("> 080#", ENABLED, HELD) == OK
    assert wire.read(HELD, "> 080#", ENABLED, period_ns=2e7) == MISSED
    assert wire.read("> 080#", ENABLED, RELEASED) == OK
    assert not wire.x[X_STATUS] & STATUS_HELD


def test_inputs_behind_demand_and_mode() -> None:
    with Wire(read_back=True) as wire:
        wire.s[w.MODE_WANTED] = wire.s[w.MODE] = 10
        wire.s[w.HELD_MASK] = 1 << 24 + 16
        for status in (0, STATUS_HELD):
            assert wire.read("> 080#", ENABLED, f"< 281#00000A0000{status // 2:02X}00") == OK
            assert wire.x[X_STATUS] & STATUS_HELD == status
        assert wire.read("> 080#", ENABLED, "< 281#00000A", period_ns=2e7) != OK  # the inputs are not in it


def test_bring_up_maps_the_inputs(bench: Bench) -> None:
    fake, open_driver = bench
    drive = fake()
    open_driver({"enable_bit": 3}, safety={"enable": True})
    assert [drive.value(0x1A01, sub) for sub in range(4)] == [3, 0x60740010, 0x60610008, 0x60FD0020]


def test_a_drive_without_inputs_is_refused(bench: Bench) -> None:
    fake, open_driver = bench
    fake(aborts={(0x60FD, 0): 0x06020000})
    with pytest.raises(
        DriverError, match=r"driver.enable_bit = 3: the drive, or its EDS, has no digital inputs 0x60fd"
    ):
        open_driver({"enable_bit": 3}, safety={"enable": True})


def test_which_input_must_be_said() -> None:
    settings = config(500, channel="/nowhere", interface="unix_seqpacket")
    settings = settings.model_copy(update={"safety": settings.safety.model_copy(update={"enable": True})})
    with pytest.raises(
        DriverConfigError, match=r"safety.enable = true: driver canopen needs driver.enable_bit, 0 to 31"
    ):
        create(settings)
