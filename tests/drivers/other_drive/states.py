"""The state diagram of CiA 402-2 as a table, and what the statusword shows of it."""

from __future__ import annotations

from typing import Final

OFF, READY, ON, ENABLED = "switch on disabled", "ready to switch on", "switched on", "operation enabled"
STOPPING, REACTING, FAULTY = "quick stop active", "fault reaction active", "fault"
POWERED: Final = (READY, ON, ENABLED, STOPPING)
"""States that need what Safe Torque Off takes away."""

SHOWN: Final = {OFF: 0x40, READY: 0x21, ON: 0x23, ENABLED: 0x27, STOPPING: 0x07, REACTING: 0x0F, FAULTY: 0x08}
"""Bits 0…3, 5 and 6 of the statusword."""
NUMBERS: Final = {OFF: 1, READY: 2, ON: 3, ENABLED: 4, STOPPING: 5, REACTING: 6, FAULTY: 7}
"""As the log counts them."""

_ARROWS: Final = {
    2: (OFF, "shutdown", READY),
    3: (READY, "switch on", ON),
    4: (ON, "enable operation", ENABLED),
    5: (ENABLED, "switch on", ON),
    6: (ON, "shutdown", READY),
    7: (READY, "disable voltage", OFF),
    8: (ENABLED, "shutdown", READY),
    9: (ENABLED, "disable voltage", OFF),
    10: (ON, "disable voltage", OFF),
    11: (ENABLED, "quick stop", STOPPING),
    12: (STOPPING, "disable voltage", OFF),
    16: (STOPPING, "enable operation", ENABLED),
}
"""By the diagram's numbers. Quick stop takes 7 and 10 too. Here 3 and 4 are two controlwords."""
_TABLE: Final = {(begin, command): end for begin, command, end in _ARROWS.values()} | {
    (READY, "quick stop"): OFF,
    (ON, "quick stop"): OFF,
    (READY, "enable operation"): ON,
}


def command(word: int) -> str:
    """What a controlword without bit 7 orders: its lowest missing bit of voltage, quick stop and switch on decides."""
    for bit, order in ((0x02, "disable voltage"), (0x04, "quick stop"), (0x01, "shutdown")):
        if not word & bit:
            return order
    return "enable operation" if word & 0x08 else "switch on"


def after(state: str, word: int, before: int, quick_stop_option: int) -> str:
    """The state after a controlword.

    Args:
        state: now. word, before: this controlword and the last one. quick_stop_option: object 0x605A.
    """
    if state == FAULTY:
        return OFF if word & 0x80 and not before & 0x80 else FAULTY
    if word & 0x80:
        return state
    order = command(word)
    if state == ENABLED and order == "quick stop" and quick_stop_option == 0:
        return OFF
    if state == STOPPING and order == "enable operation" and quick_stop_option < 5:
        return STOPPING
    return _TABLE.get((state, order), state)
