"""The electronic data sheet, and SDO access by the rules of CiA 301."""

import logging

import canopen
import numpy as np
import pytest

from hapticd.config import ConfigError
from sim_hw.canopen import layout as w
from sim_hw.canopen.dictionary import EDS, ObjectDictionary
from tests.sim_hw.canopen.master import READ_DEVICE_TYPE, SdoAbortError


def test_canopen_package_reads_the_eds_without_a_warning(caplog):
    with caplog.at_level(logging.WARNING):
        objects = canopen.objectdictionary.import_od(str(EDS), 5)
    assert not caplog.records
    assert objects[0x1800][1].default == 0x40000185
    assert objects.device_information.nr_of_RXPDO == 4
    assert {0x6040, 0x6041, 0x6071, 0x6087, 0x6502, 0x2113, 0x2340, 0x100C, 0x1018} <= set(objects)


def test_values_come_from_the_plant(start_drive):
    plant = {"amplifier": {"torque_constant": 0.05, "continuous_current": 3.0, "peak_current": 8.0}}
    _, master = start_drive(plant=plant)
    assert master.read(0x6076) == 150  # mN m
    assert master.read(0x6075) == 3000  # mA
    assert master.read(0x2110) == 800
    assert master.read(0x2111) == 300
    assert master.read(0x608F, 1) == 8192
    assert master.read(0x6502) == 0x200
    assert master.read(0x6087) == 1000


def test_strings_come_in_segments(start_drive):
    _, master = start_drive()
    assert master.read_text(0x1008) == "hapticd simulated servo drive"


REFUSED = [
    (0x5000, 0, 0, 1, 0x06020000),  # no such object
    (0x6041, 0, 0, 2, 0x06010002),  # read only
    (0x6040, 0, 0, 4, 0x06070012),  # too long
    (0x6071, 0, 0, 1, 0x06070013),  # too short
    (0x1018, 9, 0, 4, 0x06090011),  # no such sub-index
    (0x6040, 1, 0, 2, 0x06090011),
    (0x605A, 0, 9, 2, 0x06090031),  # too high
    (0x2110, 0, -1, 2, 0x06090032),  # too low
    (0x6060, 0, 8, 1, 0x06090030),  # a mode the drive does not have
    (0x2300, 0, 7, 2, 0x06090030),
    (0x1003, 0, 1, 1, 0x06090031),  # only 0 clears the history
]


def test_refused_writes_have_the_standards_abort_code(start_drive):
    _, master = start_drive()
    for index, sub, value, size, code in REFUSED:
        assert master.refused(index, sub, value, size) == code, hex(index)


def test_unknown_sdo_commands_and_toggle_errors(start_drive):
    _, master = start_drive()
    block_upload = master.request(bytes([0xA0, 0x08, 0x10, 0, 0, 0, 0, 0]))
    assert block_upload == bytes.fromhex("8008100001000405")
    assert master.request(bytes([0x60]) + bytes(7))[4:] == (0x05040001).to_bytes(4, "little")
    master.request(bytes([0x40, 0x08, 0x10, 0, 0, 0, 0, 0]))
    assert master.request(bytes([0x70]) + bytes(7))[4:] == (0x05030000).to_bytes(4, "little")
    assert master.request(bytes([0x60]) + bytes(7))[0] == 0x80


def test_segmented_download_of_a_number(start_drive):
    _, master = start_drive()
    assert master.request(bytes.fromhex("21 87 60 00 04 00 00 00"))[0] == 0x60
    assert master.request(bytes.fromhex("07 78 56 34 12 00 00 00"))[0] == 0x20
    assert master.read(0x6087) == 0x12345678


def test_missing_and_overridden_objects(start_drive):
    script = {"start": {"missing": [0x6502], "override": {0x6076: 0, "0x1018:1": 5}}}
    _, master = start_drive("--missing", "0x2113", "--set", "0x6075=7", script=script)
    for index in (0x6502, 0x2113):
        with pytest.raises(SdoAbortError) as refusal:
            master.read(index)
        assert refusal.value.args[0] == 0x06020000
    assert (master.read(0x6076), master.read(0x6075), master.read(0x1018, 1)) == (0, 7, 5)


def test_wrong_version_is_another_kind_of_device(start_drive):
    _, master = start_drive(script={"faults": [{"kind": "wrong_version"}]})
    assert master.read(0x1000) & 0xFFFF == 401
    assert master.read(0x1018, 1) == 0xFFFF


def test_node_id_and_drive_without_cyclic_torque(start_drive):
    _, master = start_drive("--node-id", "42", "--no-cst", node=42)
    assert master.read(0x6502) == 0
    assert master.refused(0x6060, 0, 10, 1) == 0x06090030
    assert master.read(0x1800, 1) == 0x400001AA
    master.send(0x601, READ_DEVICE_TYPE)
    master.read(0x1000)
    assert 0x581 not in [frame[0] for frame in master.seen]


WRONG = [
    ({(0x5000, 0): 1}, [], "here: 0x5000 = 1: the drive has no such object; its objects are those of drive.eds"),
    ({(0x1018, 9): 1}, [], "here: 0x1018:9 = 1: the object has no such sub-index"),
    ({(0x6060, 0): 300}, [], "here: 0x6060 = 300: must be between -128 and 127: it has 8 bits"),
    ({(0x6076, 0): -1}, [], "here: 0x6076 = -1: must be between 0 and 4294967295: it has 32 bits"),
    ({(0x1008, 0): 1}, [], "here: 0x1008 = 1: is a text, not a number"),
    ({(0x6076, 0): 1}, [0x6076], "here: 0x6076 = 1: is given a value, and as missing"),
    ({}, [0x5000], "here: 0x5000: cannot be missing: the drive has no such object; its objects are those of drive.eds"),
]


@pytest.mark.parametrize(("values", "missing", "message"), WRONG)
def test_power_up_values_that_cannot_be_meant(values, missing, message):
    objects = ObjectDictionary(np.zeros(w.BLOCK_WORDS, np.int64), 1, values, missing)
    with pytest.raises(ConfigError) as raised:
        objects.check("here", values, missing)
    assert str(raised.value) == message


def test_power_up_values_that_fit_are_taken():
    values = {(0x6076, 0): 2**32 - 1, (0x6060, 0): -128, (0x1018, 1): 5}
    objects = ObjectDictionary(np.zeros(w.BLOCK_WORDS, np.int64), 1, values, [0x6502])
    objects.check("here", values, [0x6502])
    assert objects[0x1018, 1] == 5
