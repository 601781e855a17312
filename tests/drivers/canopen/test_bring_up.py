"""Bring-up against canopen's own node as the drive: what is set, and every way in which it can be refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest
import yaml

import drivers
from drivers import DriverConfigError, DriverError
from drivers.canopen import CanopenDriver, bus
from drivers.canopen.profile import FOLDER
from hapticd.config import parse_config
from tests.drivers.canopen.fake_drive import FakeDrive

Open = Callable[..., CanopenDriver]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Callable[..., FakeDrive], Open]]:
    """Two functions: ``fake(**lies)`` makes the drive, ``open_driver(options, **sections)`` brings it up."""
    made: list[Any] = []
    path = tmp_path / "bus"

    def fake(node_id: int = 1, **lies: Any) -> FakeDrive:
        if "sends_first" not in lies:  # else the driver must have its time to hear it
            monkeypatch.setattr(bus, "LISTEN_S", 0.01)
        drive = FakeDrive(path, node_id, **lies)
        made.insert(0, drive)
        return drive

    def open_driver(options: dict[str, Any] | None = None, **sections: Any) -> CanopenDriver:
        given = {"name": "canopen", "interface": "unix_seqpacket", "channel": str(path), **(options or {})}
        driver = drivers.create(parse_config({"driver": given, **sections}, "test"))
        assert isinstance(driver, CanopenDriver)
        made.insert(0, driver)
        driver.open()
        return driver

    yield fake, open_driver
    for thing in made:
        thing.close()


Bench = tuple[Callable[..., FakeDrive], Open]


def test_a_drive_is_set_up_and_left_disabled(bench: Bench) -> None:
    fake, open_driver = bench
    drive = fake()
    driver = open_driver({"watchdog_ms": 80})
    expected = {
        (0x6060, 0): 10,
        (0x2300, 0): 30,
        (0x6087, 0): 0,
        (0x2113, 0): 0,
        (0x2110, 0): 600,
        (0x2111, 0): 200,
        (0x2112, 0): 1000,
        (0x605A, 0): 0,
        (0x605E, 0): 0,
        (0x6071, 0): 0,
        (0x100C, 0): 20,
        (0x100D, 0): 4,
        (0x1017, 0): 0,
        (0x1800, 1): 0x181,
        (0x1800, 2): 1,
        (0x1A00, 0): 3,
        (0x1A00, 1): 0x60410010,
        (0x1A00, 2): 0x60630020,
        (0x1A00, 3): 0x221C0010,
        (0x1801, 1): 0x281,
        (0x1801, 2): 1,
        (0x1A01, 0): 2,
        (0x1A01, 1): 0x60740010,
        (0x1A01, 2): 0x60610008,
        (0x1400, 1): 0x201,
        (0x1400, 2): 255,
        (0x1600, 0): 2,
        (0x1600, 1): 0x60400010,
        (0x1600, 2): 0x60710010,
    }
    assert {key: drive.value(*key) for key in expected} == expected
    assert drive.value(0x6041) == 0x0250
    assert drive.node.nmt.state == "OPERATIONAL"
    assert driver.describe() == (
        "CANopen drive, cyclic synchronous torque, 1.99 mA per step, read back (vendor 0xab, product 0x0, revision 0x0, "
        f"serial number 0), on unix_seqpacket {drive.path}, node 1, 1000 kbit/s, bus load 38% (fastest rate 2281 Hz)"
    )
    driver.close()
    driver.close()
    assert (drive.value(0x100C), drive.value(0x100D), drive.value(0x6041)) == (0, 0, 0x0250)
    assert drive.node.nmt.state == "PRE-OPERATIONAL"


@pytest.mark.parametrize(
    ("options", "lies"),
    [
        ({"read_back": False}, {}),
        ({}, {"aborts": {(0x6074, 0): 0x06020000}}),
        ({}, {"overrides": {(0x6502, 0): 1 << 3}}),  # programmed current: the profile names no demand
    ],
)
def test_without_a_demand_nothing_is_read_back(bench: Bench, options: dict[str, Any], lies: dict[str, Any]) -> None:
    fake, open_driver = bench
    drive = fake(**lies)
    driver = open_driver(options)
    assert "per step, not read back (" in driver.describe()
    assert drive.value(0x1801, 1) & 0x80000000


def test_a_drive_that_watches_rpdo_1_is_told_the_deadline(bench: Bench) -> None:
    fake, open_driver = bench
    drive = fake(eds=FOLDER / "cia402.eds")
    driver = open_driver({"profile": "cia402", "watchdog_ms": 60})
    assert drive.value(0x1400, 5) == 60
    driver.close()
    assert drive.value(0x1400, 5) == 0


def test_programmed_current_where_there_is_no_cyclic_torque(bench: Bench) -> None:
    fake, open_driver = bench
    drive = fake(overrides={(0x6502, 0): 1 << 3})
    driver = open_driver()
    assert drive.value(0x2300) == 1
    assert drive.value(0x1600, 2) == 0x23400010
    assert "programmed current, 10 mA per step" in driver.describe()


def test_a_standing_fault_is_reset_by_one_edge(bench: Bench) -> None:
    fake, open_driver = bench
    drive = fake(overrides={(0x6041, 0): 0x0218})
    open_driver()
    words = [bytes(m.data) for m in drive.heard if m.arbitration_id == 0x601 and m.data[:4] == b"\x2b\x40\x60\x00"]
    assert [word[4] for word in words] == [0x00, 0x80, 0x00]
    assert drive.value(0x6041) == 0x0250


def test_another_vendor_is_another_file(bench: Bench, tmp_path: Path) -> None:
    fake, open_driver = bench
    profile = yaml.safe_load((FOLDER / "cia402.yaml").read_text())
    profile |= {"name": "Another", "eds": str(FOLDER / "cia402.eds"), "position": 0x6064, "master_id": 3}
    path = tmp_path / "another.yaml"
    path.write_text(yaml.safe_dump(profile))
    drive = fake(eds=FOLDER / "cia402.eds")
    driver = open_driver({"profile": str(path)})
    assert drive.value(0x1016, 1) == 3 << 16 | 100
    assert drive.value(0x1A00, 2) == 0x60640020
    assert drive.value(0x6073) == 3000
    assert "profile Another" not in driver.describe()
    assert driver.state_address


REFUSALS: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    (
        {"overrides": {(0x1000, 0): 0x00030191}},
        {},
        "node 1 is not a drive: its device type 0x1000 is 0x00030191, profile 401",
    ),
    ({"aborts": {(0x2113, 0): 0x06020000}}, {}, "the drive has no object 0x2113, though the EDS copley.eds has it"),
    (
        {"keeps": {(0x6087, 0): 1000}},
        {},
        "torque slope (‰/s, 0 is unlimited) (0x6087): 0 was written, but the drive keeps 1000",
    ),
    (
        {"keeps": {(0x2113, 0): 2000}},
        {},
        "current ramp (mA/s, 0 is unlimited) (0x2113): 0 was written, but the drive keeps",
    ),
    (
        {"write_aborts": {(0x2110, 0): 0x06090031}},
        {},
        "amplifier.peak_current = 6 A: writing 600 to peak current limit (0.01 A) (0x2110): the drive refuses: Value of "
        "parameter written too high (abort code 0x06090031)",
    ),
    (
        {"keeps": {(0x2111, 0): 150}},
        {},
        "amplifier.continuous_current = 2 A: continuous current limit (0.01 A) (0x2111): 200",
    ),
    (
        {"aborts": {(0x6072, 0): 0x06020000}},
        {"amplifier": {"peak_current": 400}},
        "40000 does not fit into the 16 bits of the EDS",
    ),
    (
        {"write_aborts": {(0x1A00, 3): 0x06040041}},
        {},
        "mapping of actual current (0x221c) into TPDO 1 (0x1a00:3): the drive ref",
    ),
    ({"keeps": {(0x1600, 2): 0x23400010}}, {}, "mapping of target of cyclic synchronous torque (0x6071) into RPDO 1"),
    (
        {"keeps": {(0x1800, 2): 254}},
        {},
        "transmission type of TPDO 1 (0x1800:2): 1 was written, but the drive keeps 254",
    ),
    ({"keeps": {(0x100C, 0): 0}}, {}, "guard time (ms) (0x100c): 25 was written, but the drive keeps 0"),
    (
        {"overrides": {(0x6061, 0): 3}},
        {},
        "cyclic synchronous torque: the drive shows mode 3 (0x6061) though 10 was set",
    ),
    ({"overrides": {(0x6076, 0): 0}}, {}, "rated torque 0x6076 is 0: the motor is not configured in the drive"),
    (
        {"overrides": {(0x6076, 0): 116}},
        {},
        "the drive's motor has 0.058 N m/A (rated torque 0x6076 = 116 mN m at rated cur",
    ),
    (
        {"overrides": {(0x6041, 0): 0x0237}, "stuck": True},
        {},
        "Operation enabled → Switch on disabled: statusword 0x0237, waited 0.5 s",
    ),
    (
        {"overrides": {(0x6041, 0): 0x0218}, "stuck": True},
        {},
        "Fault → Switch on disabled: statusword 0x0218, waited 0.5 s; the cause of the fault is still present",
    ),
    ({"node_id": 5}, {}, "node 1 does not reply, but there is node 5: set driver.node_id = 5"),
    ({"mute": True}, {}, "node 1 does not reply, and no other node does: check the drive's supply, the wiring"),
    (
        {"sends_first": [can.Message(arbitration_id=0x80, is_extended_id=False)]},
        {},
        "another master is on the bus: SYNC (0x080) was received, and this driver did not send it",
    ),
    (
        {"sends_first": [can.Message(arbitration_id=0x601, is_extended_id=False, data=bytes(8))]},
        {},
        "another master is on the bus: an SDO request to node 1 (0x601) was received",
    ),
]


@pytest.mark.parametrize(("lies", "sections", "text"), REFUSALS)
def test_refusals(bench: Bench, lies: dict[str, Any], sections: dict[str, Any], text: str) -> None:
    fake, open_driver = bench
    fake(**lies)
    with pytest.raises(DriverError) as caught:
        open_driver(**sections)
    assert text in str(caught.value)
    assert str(caught.value).startswith("unix_seqpacket ")


ONLY_TORQUE = {"aborts": {(0x6075, 0): 0x06020000}}
IMPLAUSIBLE: list[tuple[dict[str, Any], dict[str, Any], dict[str, Any], tuple[str, ...]]] = [
    (
        {**ONLY_TORQUE, "overrides": {(0x6076, 0): 6}},
        {},
        {},
        (
            "rated torque 0x6076 = 6 mN m is a rated current of 0.205 A, 0.103 times amplifier.continuous_current = 2 A",
            "makes 9.73 times every commanded current",
            "6 cN m would be 2.05 A, so the drive's unit is most likely cN m",
            "driver.rated_torque (in N m)",
        ),
    ),
    (
        {**ONLY_TORQUE, "overrides": {(0x6076, 0): 58400}},
        {},
        {},
        (
            "0x6076 = 58400 mN m is a rated current of 2e+03 A",
            "58400 µN m would be 2 A, so the drive's unit is most likely µN m",
        ),
    ),
    (
        {**ONLY_TORQUE, "overrides": {(0x6076, 0): 584}},
        {},
        {},
        ("584 0.1 mN m would be 2 A",),
    ),
    (
        {**ONLY_TORQUE, "overrides": {(0x6076, 0): 6}},
        {},
        {"amplifier": {"continuous_current": 0}},
        ("0.103 times a third of amplifier.peak_current = 2 A",),
    ),
    (
        {"overrides": {(0x6076, 0): 6}},
        {},
        {},
        (
            "the drive's motor has 0.003 N m/A (rated torque 0x6076 = 6 mN m at rated current 0x6075 = 2000 mA), "
            "amplifier.torque_constant is 0.0292: 6 cN m would be 2.05 A, so the drive's unit is most likely cN m",
        ),
    ),
    (
        {"overrides": {(0x6076, 0): 58400, (0x6075, 0): 2_000_000}},
        {},
        {},
        ("rated current 0x6075 = 2000000 mA is a rated current of 2e+03 A, 1e+03 times", "unit is most likely µA"),
    ),
    (
        {"overrides": {(0x6075, 0): 2}, "aborts": {(0x6076, 0): 0x06020000}},
        {},
        {},
        (
            "rated current 0x6075 = 2 mA is a rated current of 0.002 A",
            "2 A would be 2 A, so the drive's unit is most likely A",
        ),
    ),
    (
        {**ONLY_TORQUE, "overrides": {(0x6076, 0): 20}},
        {},
        {},
        ("0.342 times amplifier.continuous_current", "In no usual unit would it be near 2 A"),
    ),
    (
        {**ONLY_TORQUE, "overrides": {(0x6076, 0): 400}},
        {},
        {"encoder": {"counts_per_metre": 1e6}, "amplifier": {"torque_constant": 20.0}, "plant": {"inertia": 0.1}},
        ("rated torque 0x6076 = 400 mN is a rated current of 0.02 A", "400 0.1 N would be 2 A"),
    ),
    (
        {"overrides": {(0x6076, 0): 58400}},
        {"rated_torque": 0.077},
        {},
        ("driver.rated_torque = 0.077 N m, but rated torque 0x6076 = 58400 is not so in any of N m, cN m",),
    ),
    (
        {"overrides": {(0x6072, 0): 1000}},
        {},
        {},
        ("max torque 0x6072 = 1000 ‰ clips the command at 1.99 A, and amplifier.peak_current is 6 A",),
    ),
    (
        {"overrides": {(0x608F, 1): 2048}},
        {},
        {},
        (
            "position encoder resolution 0x608f is 2048 counts in 1 revolutions, 2048 counts/rev; encoder.counts_per_rev is "
            "8192: one of the two counts lines",
        ),
    ),
    (
        {"overrides": {(0x608F, 1): 10000}},
        {},
        {},
        ("10000 counts/rev; encoder.counts_per_rev is 8192: one of the two is for another encoder",),
    ),
    (
        {"overrides": {(0x2110, 0): 100}},
        {},
        {},
        ("amplifier.peak_current = 6 A is 6 times the limit stored in the drive: peak current limit (0.01 A)",),
    ),
    (
        {"overrides": {(0x6502, 0): 1 << 3}},
        {},
        {"amplifier": {"peak_current": 0.2, "continuous_current": 0.1}, "dither": {"target": "none"}},
        ("0x6075 = 2000 mA is a rated current of 2 A, 20 times amplifier.continuous_current = 0.1 A",),
    ),
    (
        {"overrides": {(0x6502, 0): 1 << 3}},
        {"rated_current": 2.0, "rated_torque": 0.058},
        {"amplifier": {"peak_current": 0.2, "continuous_current": 0.1}},
        ("one step of the command (programmed current, 0x2340) is 0.01 A, and amplifier.peak_current = 0.2 A is 20",),
    ),
]


@pytest.mark.parametrize(("lies", "options", "sections", "texts"), IMPLAUSIBLE)
def test_what_a_drive_says_is_not_believed(
    bench: Bench, lies: dict[str, Any], options: dict[str, Any], sections: dict[str, Any], texts: tuple[str, ...]
) -> None:
    fake, open_driver = bench
    drive = fake(**lies)
    with pytest.raises(DriverError) as caught:
        open_driver(options, **sections)
    for text in texts:
        assert text in str(caught.value)
    assert drive.node.nmt.state == "PRE-OPERATIONAL"


@pytest.mark.parametrize(("raw", "unit"), [(58400, 1e-6), (6, 1e-2), (58, 1e-3)])
def test_a_stated_rated_torque_goes_before_the_drives_number(bench: Bench, raw: int, unit: float) -> None:
    fake, open_driver = bench
    fake(**ONLY_TORQUE, overrides={(0x6076, 0): raw})
    driver = open_driver({"rated_torque": 0.0584})
    assert "cyclic synchronous torque, 2 mA per step" in driver.describe()


def edited_eds(tmp_path: Path, old: str, new: str) -> Path:
    """The Copley EDS with one thing changed."""
    text = (FOLDER / "copley.eds").read_text()
    assert old in text
    path = tmp_path / "edited.eds"
    path.write_text(text.replace(old, new, 1))
    return path


EDS_REFUSALS = [
    ("[2113]", "[2114]", "current ramp (mA/s, 0 is unlimited) (0x2113) is missing in the EDS edited.eds"),
    (
        "VendorNumber=0",
        "VendorNumber=0xAC",
        "vendor-ID: the EDS edited.eds is for 0x000000ac, the drive has 0x000000ab",
    ),
    (
        "ParameterName=Actual motor current\nObjectType=0x7\nDataType=0x0003",
        "ParameterName=Actual motor current\nObjectType=0x7\nDataType=0x0004",
        "actual current (0x221c) has 32 bits in the EDS; TPDO 1 has room for 16",
    ),
    (
        "ParameterName=Target torque\nObjectType=0x7\nDataType=0x0003\nAccessType=rw\nDefaultValue=0\nPDOMapping=1",
        "ParameterName=Target torque\nObjectType=0x7\nDataType=0x0003\nAccessType=rw\nDefaultValue=0\nPDOMapping=0",
        "target of cyclic synchronous torque (0x6071) cannot be mapped into RPDO 1: the EDS does not allow it",
    ),
    (
        "ParameterName=Statusword\nObjectType=0x7\nDataType=0x0006",
        "ParameterName=Statusword\nObjectType=0x7\nDataType=0x0007",
        "statusword (0x6041) has 4 bytes in the EDS edited.eds, but the drive sends 2: this is not the drive's EDS",
    ),
]


@pytest.mark.parametrize(("old", "new", "text"), EDS_REFUSALS)
def test_eds_and_drive_disagree(bench: Bench, tmp_path: Path, old: str, new: str, text: str) -> None:
    fake, open_driver = bench
    fake()
    with pytest.raises(DriverError) as caught:
        open_driver({"eds": str(edited_eds(tmp_path, old, new))})
    assert text in str(caught.value)


def test_profile_of_another_vendor(bench: Bench, tmp_path: Path) -> None:
    fake, open_driver = bench
    fake()
    profile = yaml.safe_load((FOLDER / "copley.yaml").read_text()) | {
        "vendor_id": 0xAC,
        "eds": str(FOLDER / "copley.eds"),
    }
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(profile))
    with pytest.raises(DriverError, match=r"node 1 has vendor-ID 0x000000ab, driver.profile .* is for 0x000000ac"):
        open_driver({"profile": str(path)})


def test_no_mode_that_fits(bench: Bench, tmp_path: Path) -> None:
    fake, open_driver = bench
    fake(overrides={(0x6502, 0): 0x25})
    profile = yaml.safe_load((FOLDER / "copley.yaml").read_text())
    profile |= {"modes": profile["modes"][:1], "eds": str(FOLDER / "copley.eds")}
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(profile))
    with pytest.raises(DriverError, match=r"\(0x6502\) is 0x00000025, wanted cyclic synchronous torque \(10\)"):
        open_driver({"profile": str(path)})


def test_nobody_listens(tmp_path: Path) -> None:
    given = {"name": "canopen", "interface": "unix_seqpacket", "channel": str(tmp_path / "none")}
    driver = drivers.create(parse_config({"driver": given}, "test"))
    with pytest.raises(DriverError, match=r"CAN interface unix_seqpacket, channel .*none: no CAN bus on the socket"):
        driver.open()
    driver.close()


def test_no_such_can_interface() -> None:
    driver = drivers.create(parse_config({"driver": {"name": "canopen", "channel": "hapticd-none"}}, "test"))
    with pytest.raises(
        DriverError, match=r"channel hapticd-none: .*; is it up\? sudo ip link set hapticd-none up type can"
    ):
        driver.open()
    driver.close()


def test_an_interface_that_gives_frames_back_is_refused_on_the_compiled_path(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake, open_driver = bench
    fake()
    monkeypatch.setattr(bus, "stop_node", bus.stop_node)
    monkeypatch.setattr("drivers.canopen.bring_up.stop_node", lambda *given: bus.stop_node(*given) or True)
    with pytest.raises(DriverError, match="returns our own frames"):
        open_driver()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"nodeid": 1}, "driver.nodeid: driver canopen has no such option; did you mean driver.node_id?"),
        ({"node_id": 0}, "driver.node_id = 0: must be a whole number from 1 to 127"),
        ({"node_id": True}, "driver.node_id = True: must be a whole number"),
        ({"bitrate": 300000}, "driver.bitrate = 300000: must be one of CiA 301's"),
        ({"watchdog_ms": 3}, "driver.watchdog_ms = 3: must be a whole number from 4 to 60000 ms"),
        ({"reply_timeout_s": 0}, "driver.reply_timeout_s = 0: must be above 0 s"),
        ({"reply_timeout_s": 0.001}, "driver.reply_timeout_s = 0.001 s is more than 80% of the servo period (0.0008 s"),
        ({"latency_s": -1}, "driver.latency_s = -1: must be a time from 0 to 1 s"),
        ({"rated_torque": 0}, "driver.rated_torque = 0: must be above 0 N m"),
        ({"rated_current": "2 A"}, "driver.rated_current = '2 A': must be above 0 A"),
        ({"channel": 5}, "driver.channel = 5: must be text"),
        ({"interface": "udp_multicast"}, "driver.channel is missing: name the channel of udp_multicast"),
        ({"bus": 3}, "driver.bus = 3: must be a mapping"),
        ({"profile": "maxon"}, "driver.profile = 'maxon': no such profile (cia402, copley) and no such file"),
        ({"eds": "/none.eds"}, "driver.eds = '/none.eds': no such file"),
    ],
)
def test_wrong_options(options: dict[str, Any], text: str) -> None:
    with pytest.raises(DriverConfigError) as caught:
        drivers.create(parse_config({"driver": {"name": "canopen", **options}}, "test"))
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("rate_hz", "options", "text"),
    [
        (
            2400,
            {},
            "would fill 89% of the bus at driver.bitrate = 1000000 bit/s; the loop may fill 85%, which allows 2284 Hz "
            "(driver.read_back: false: 2965 Hz)",
        ),
        (3000, {"read_back": False}, "would fill 86% of the bus at driver.bitrate = 1000000 bit/s"),
        (1000, {"bitrate": 250_000}, "which allows 561 Hz"),
        (
            39,
            {},
            "the loop must send a guarding message every 25 ms (a quarter of driver.watchdog_ms = 100), and one "
            "period is 25.641 ms; set driver.watchdog_ms to 104 or more, or servo.rate_hz to 40 Hz or more",
        ),
    ],
)
def test_rates_that_bus_or_watchdog_do_not_allow(rate_hz: float, options: dict[str, Any], text: str) -> None:
    with pytest.raises(DriverConfigError) as caught:
        drivers.create(parse_config({"driver": {"name": "canopen", **options}, "servo": {"rate_hz": rate_hz}}, "test"))
    assert text in str(caught.value)


@pytest.mark.parametrize("rate_hz", [1, 7, 39.9, 100, 2284])
def test_the_advice_about_a_slow_rate_is_enough(rate_hz: float) -> None:
    driver = drivers.create(parse_config({"driver": {"name": "canopen"}, "servo": {"rate_hz": 100}}, "test"))
    text = driver.check_rate(rate_hz)
    if rate_hz >= 40:
        assert text is None
        return
    assert text is not None
    watchdog_ms = int(text.split("driver.watchdog_ms to ")[1].split()[0])
    config = {"driver": {"name": "canopen", "watchdog_ms": watchdog_ms}, "servo": {"rate_hz": rate_hz}}
    assert drivers.create(parse_config(config, "test")).check_rate(rate_hz) is None
