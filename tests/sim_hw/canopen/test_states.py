"""The CiA 402 state machine, transition by transition, over the bus."""

import pytest

from sim_hw.canopen import states
from tests.sim_hw.canopen.master import (
    DISABLED,
    ENABLED,
    FAULT,
    QUICK_STOP,
    REACTION,
    READY,
    SWITCHED_ON,
)

SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF, STOP, RESET = 0x06, 0x07, 0x0F, 0x00, 0x02, 0x80
WALKS = {
    "2": ([SHUTDOWN], READY),
    "3": ([SHUTDOWN, SWITCH_ON], SWITCHED_ON),
    "4": ([SHUTDOWN, SWITCH_ON, ENABLE], ENABLED),
    "3 and 4": ([SHUTDOWN, ENABLE], ENABLED),
    "5": ([SHUTDOWN, SWITCH_ON, ENABLE, SWITCH_ON], SWITCHED_ON),
    "6": ([SHUTDOWN, SWITCH_ON, SHUTDOWN], READY),
    "7": ([SHUTDOWN, VOLTAGE_OFF], DISABLED),
    "7 by quick stop": ([SHUTDOWN, STOP], DISABLED),
    "8": ([SHUTDOWN, SWITCH_ON, ENABLE, SHUTDOWN], READY),
    "9": ([SHUTDOWN, SWITCH_ON, ENABLE, VOLTAGE_OFF], DISABLED),
    "10": ([SHUTDOWN, SWITCH_ON, VOLTAGE_OFF], DISABLED),
    "no enable from disabled": ([SWITCH_ON, ENABLE], DISABLED),
}


@pytest.fixture
def master(start_drive):
    return start_drive()[1]


def test_every_transition_by_controlword(master):
    assert master.state() == DISABLED  # 0 and 1
    for name, (words, expected) in WALKS.items():
        for word in words:
            state = master.control(word)
        assert state == expected, name
        master.control(VOLTAGE_OFF)


def test_quick_stop_ends_by_itself_or_stays_by_its_option(master):
    master.write(0x605A, 0, 6, 2)
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        master.control(word)
    assert master.control(STOP) == QUICK_STOP  # 11
    assert master.control(ENABLE) == ENABLED  # 16
    assert master.control(STOP) == QUICK_STOP
    assert master.control(VOLTAGE_OFF) == DISABLED  # 12
    master.write(0x605A, 0, 0, 2)
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        master.control(word)
    assert master.control(STOP) == DISABLED
    master.write(0x605A, 0, 2, 2)
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        master.control(word)
    master.control(STOP)
    assert master.wait_state(DISABLED) <= {QUICK_STOP}  # 12 after 10 ms


def test_fault_and_its_reset_on_the_rising_edge(start_drive):
    _, master = start_drive(script={"faults": [{"kind": "emcy", "at_s": 0.05, "from": "enabled", "code": 0x2310}]})
    master.bring_up(enable=False)
    master.enable()
    emergency = master.wait_for(0x81)
    assert emergency == bytes.fromhex("1023 03 04000000 00")  # error code, register, latched faults
    assert master.wait_state(FAULT) <= {REACTION}  # 13 and 14
    assert master.read(0x603F) == 0x2310
    assert master.read(0x1001) == 0x03
    assert master.read(0x1003, 1) == 0x2310
    assert master.read(0x1003, 0) == 1
    assert master.read(0x2183) == 1 << 2
    assert master.read(0x1002) & 1 << 22
    assert master.control(SHUTDOWN) == FAULT
    master.seen.clear()
    assert master.control(RESET) == DISABLED  # 15
    assert (0x81, bytes(8)) in master.seen
    assert (master.read(0x603F), master.read(0x1001), master.read(0x2183)) == (0, 0, 0)
    assert master.read(0x1003, 0) == 1
    master.write(0x1003, 0, 0, 1)
    assert master.read(0x1003, 0) == 0


def test_held_reset_bit_resets_one_fault_only():
    assert states.next_state(states.FAULT, 0x80, 0x80, 2) == states.FAULT
    assert states.next_state(states.FAULT, 0x80, 0x00, 2) == states.SWITCH_ON_DISABLED
    assert states.next_state(states.FAULT_REACTION_ACTIVE, 0x80, 0x00, 2) == states.FAULT_REACTION_ACTIVE


def test_state_bits_are_the_standards():
    shown = [states.state_bits(state) for state in range(8)]
    assert shown == [0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08]
