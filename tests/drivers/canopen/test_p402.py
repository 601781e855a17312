"""Our state machine against python-canopen's: the cases of its own tests of CiA 402, for every statusword."""

from __future__ import annotations

import pytest
from canopen.profiles.p402 import State402

from drivers.canopen.state_machine import (
    ENABLED,
    NAMES,
    next_controlword,
    state_of,
)


def their_state(statusword: int) -> str | None:
    for name, (mask, bits) in State402.SW_MASK.items():
        if statusword & mask == bits:
            return name
    return None


def test_every_statusword_is_read_alike() -> None:
    for statusword in range(1 << 16):
        ours = NAMES.get(int(state_of(statusword)))
        assert (None if ours is None else ours.upper()) == their_state(statusword), hex(statusword)


@pytest.mark.parametrize("state", sorted(State402.SW_MASK))
def test_the_way_to_operation_enabled_is_theirs(state: str) -> None:
    """One command a state; those that the drive leaves by itself, or by an edge of bit 7 alone, get no command."""
    word = int(next_controlword(State402.SW_MASK[state][1]))
    if state == NAMES[ENABLED].upper():
        assert word == State402.CW_OPERATION_ENABLED
    elif state in ("FAULT", "FAULT REACTION ACTIVE", "NOT READY TO SWITCH ON"):
        assert word == State402.CW_DISABLE_VOLTAGE
    else:
        assert word == State402.TRANSITIONTABLE[state, State402.next_state_indirect(state)]


@pytest.mark.parametrize("begin", ["SWITCH ON DISABLED", "READY TO SWITCH ON", "SWITCHED ON", "QUICK STOP ACTIVE"])
def test_walking_ends_in_operation_enabled(begin: str) -> None:
    commands = {(state, word): end for (state, end), word in State402.TRANSITIONTABLE.items()}
    state, steps = begin, 0
    while state != "OPERATION ENABLED":
        state = commands[state, int(next_controlword(State402.SW_MASK[state][1]))]
        steps += 1
    assert steps <= 4
