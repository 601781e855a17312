"""The CiA 402 state machine: transitions by controlwords, and the statusword of each state.

States and transitions are those of IEC 61800-7-201 (CiA 402-2), with its numbers. Transitions 0 and 1 (boot), 13
and 14 (fault reaction) are automatic; every other one follows a controlword.
"""

from __future__ import annotations

from hapticd.jit import njit

(
    NOT_READY_TO_SWITCH_ON,
    SWITCH_ON_DISABLED,
    READY_TO_SWITCH_ON,
    SWITCHED_ON,
    OPERATION_ENABLED,
    QUICK_STOP_ACTIVE,
    FAULT_REACTION_ACTIVE,
    FAULT,
) = range(8)
_STATE_BITS = (0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08)

FAULT_RESET = 0x80
_QUICK_STOP_STAYS = 5
"""Quick stop option codes from this one on stay in Quick Stop Active (0x605A)."""


@njit("int64(int64, int64, int64, int64)", counted=False)
def next_state(state: int, control: int, previous: int, quick_stop_option: int) -> int:
    """State after a controlword.

    Args:
        state: present state.
        control: controlword just received.
        previous: the one before; a fault is reset only by the rising edge of bit 7.
        quick_stop_option: 0x605A.
    """
    disable_voltage = control & 0x82 == 0x00
    quick_stop = control & 0x86 == 0x02
    shutdown = control & 0x87 == 0x06
    switch_on = control & 0x8F == 0x07
    enable = control & 0x8F == 0x0F
    new = state
    if state == FAULT:
        if control & FAULT_RESET and not previous & FAULT_RESET:
            new = SWITCH_ON_DISABLED  # 15
    elif state == SWITCH_ON_DISABLED:
        if shutdown:
            new = READY_TO_SWITCH_ON  # 2
    elif state in (READY_TO_SWITCH_ON, SWITCHED_ON, OPERATION_ENABLED):
        if disable_voltage:
            new = SWITCH_ON_DISABLED  # 7, 10, 9
        elif quick_stop:
            # 7, 10; 11. Option 0 switches the power stage off instead of stopping.
            stops = state == OPERATION_ENABLED and quick_stop_option != 0
            new = QUICK_STOP_ACTIVE if stops else SWITCH_ON_DISABLED
        elif shutdown:
            new = READY_TO_SWITCH_ON  # 6, 8
        elif switch_on:
            new = SWITCHED_ON  # 3, 5
        elif enable:
            new = OPERATION_ENABLED  # 4; from Ready To Switch On 3 and 4 at once, as the profile allows
    elif state == QUICK_STOP_ACTIVE:
        if disable_voltage:
            new = SWITCH_ON_DISABLED  # 12
        elif enable and quick_stop_option >= _QUICK_STOP_STAYS:
            new = OPERATION_ENABLED  # 16
    return new


@njit("int64(int64)", counted=False)
def state_bits(state: int) -> int:
    """Bits 0…3, 5 and 6 of the statusword."""
    return _STATE_BITS[state]
