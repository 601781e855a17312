"""The CiA 402 state machine: its states, the next controlword, and its transitions in words.

Statusword (0x6041) and controlword (0x6040) as in CiA 402-2, 7.3 and 8: a state is a pattern in the statusword's bits 0…3,
5 and 6; a command is a pattern in the controlword's bits 0…3 and 7.
"""

from __future__ import annotations

from typing import Final

from hapticd.jit import njit

NOT_READY: Final = 0x00
SWITCH_ON_DISABLED: Final = 0x40
READY: Final = 0x21
SWITCHED_ON: Final = 0x23
ENABLED: Final = 0x27
QUICK_STOP_ACTIVE: Final = 0x07
FAULT_REACTION: Final = 0x0F
FAULT: Final = 0x08

NAMES: Final = {
    NOT_READY: "Not ready to switch on",
    SWITCH_ON_DISABLED: "Switch on disabled",
    READY: "Ready to switch on",
    SWITCHED_ON: "Switched on",
    ENABLED: "Operation enabled",
    QUICK_STOP_ACTIVE: "Quick stop active",
    FAULT_REACTION: "Fault reaction active",
    FAULT: "Fault",
}
FAULT_BIT: Final = 0x08

DISABLE_VOLTAGE: Final = 0x00
SHUTDOWN: Final = 0x06
SWITCH_ON: Final = 0x07
ENABLE_OPERATION: Final = 0x0F
QUICK_STOP: Final = 0x02
FAULT_RESET: Final = 0x80

_NEXT: Final = {
    NOT_READY: SWITCH_ON_DISABLED,
    SWITCH_ON_DISABLED: READY,
    READY: SWITCHED_ON,
    SWITCHED_ON: ENABLED,
    QUICK_STOP_ACTIVE: SWITCH_ON_DISABLED,
    FAULT_REACTION: FAULT,
    FAULT: SWITCH_ON_DISABLED,
}


@njit("int64(int64)", counted=False)
def state_of(statusword: int) -> int:
    """The state in a statusword: one of the constants above; bits that the state does not define are masked."""
    if statusword & 0x4F in (NOT_READY, SWITCH_ON_DISABLED, FAULT_REACTION, FAULT):
        return statusword & 0x4F
    return statusword & 0x6F


@njit("int64(int64)", counted=False)
def next_controlword(statusword: int) -> int:
    """The command for the next transition towards Operation enabled; disable voltage if there is none.

    A fault is not reset here: that needs an edge of bit 7.
    """
    state = state_of(statusword)
    if state == SWITCH_ON_DISABLED:
        return SHUTDOWN
    if state == READY:
        return SWITCH_ON
    if state in (SWITCHED_ON, ENABLED):
        return ENABLE_OPERATION
    return DISABLE_VOLTAGE


def name_of(statusword: int) -> str:
    """The state in words."""
    state = int(state_of(statusword))
    return NAMES.get(state, f"state 0x{state:02x}, which is not in CiA 402,")


def transition(statusword: int, waited_s: float, target: int | None = None) -> str:
    """A missing transition, in words.

    Args:
        statusword: of the drive. waited_s: waiting time, s.
        target: the expected state; default: the next one towards Operation enabled.
    """
    goal = target if target is not None else _NEXT.get(int(state_of(statusword)), ENABLED)
    hint = "" if statusword & 0x10 else "; bit 4 is 0: no voltage at the power stage"
    if statusword & FAULT_BIT:
        hint = "; the cause of the fault is still present"
    return f"{name_of(statusword)} → {NAMES[goal]}: statusword 0x{statusword:04x}, waited {waited_s:g} s{hint}"
