"""The kinds of fault in a script, their keys and limits, and their table for the compiled service."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sim_hw import layout as w

if TYPE_CHECKING:
    from numpy.typing import NDArray

LONGEST_S = 1e6
"""Longest time in a script, s."""

REQUEST, REPLY, COMMAND = 1, 2, 4
SYNC, TPDO, RPDO = 8, 16, 32
ANY = 63
FRAMES = {
    "serial": {"request": REQUEST, "reply": REPLY, "command": COMMAND, "any": ANY},
    "canopen": {"request": REQUEST, "reply": REPLY, "sync": SYNC, "tpdo": TPDO, "rpdo": RPDO, "any": ANY},
}
"""Frames to which a fault can be limited, by device; on CAN ``request`` and ``reply`` are those of SDO."""

ORIGINS = {"start": 0, "enabled": 1}
"""Origin of ``at_s``: the device's start, or the first enable of its amplifier."""
SIGNAL = 2
FAULT_ORIGINS = {**ORIGINS, "signal": SIGNAL}
"""A fault may also wait for SIGUSR1."""

DROP, CORRUPT, DUPLICATE, DELAY, REORDER = range(5)
GARBAGE, FREEZE_COUNTER, ENCODER_GLITCH, UNPLUG, SILENT = range(5, 10)
WRONG_VERSION, BUS_OFF, EMERGENCY, LEAVE_OPERATION_ENABLED, REBOOT = range(10, 15)
ENCODER_FAULT, AMPLIFIER_FAULT, EXTERNAL_STOP = range(15, 18)
MEASURED_CURRENT, SECOND_NODE, FOREIGN_SDO, RELEASED = range(18, 22)
LAST_FRAME_FAULT = REORDER
"""Kinds up to this one act on single frames; the others at an instant."""
DROPPED, CORRUPTED, DUPLICATED, DELAYED, REORDERED = (1 << kind for kind in range(LAST_FRAME_FAULT + 1))
"""Bits of the faults of a frame, see :func:`sim_hw._faults.frame_fate`."""


@dataclass(frozen=True)
class Kind:
    """A kind of fault: number in the log, keys besides ``kind``, required keys, devices that have it."""

    number: int
    keys: tuple[str, ...]
    required: tuple[str, ...]
    devices: tuple[str, ...] = ("serial", "canopen")


_WHEN = ("at_s", "from")
_FRAMES = (*_WHEN, "frames", "count")
KINDS = {
    "drop": Kind(DROP, _FRAMES, ("at_s",)),
    "corrupt": Kind(CORRUPT, _FRAMES, ("at_s",)),
    "duplicate": Kind(DUPLICATE, _FRAMES, ("at_s",)),
    "delay": Kind(DELAY, (*_FRAMES, "delay_s"), ("at_s", "delay_s")),
    "reorder": Kind(REORDER, _FRAMES, ("at_s",)),
    "garbage": Kind(GARBAGE, (*_WHEN, "bytes"), ("at_s", "bytes"), ("serial",)),
    "freeze_counter": Kind(FREEZE_COUNTER, (*_WHEN, "duration_s"), ("at_s", "duration_s")),
    "encoder_glitch": Kind(ENCODER_GLITCH, (*_WHEN, "counts", "count"), ("at_s", "counts")),
    "unplug": Kind(UNPLUG, (*_WHEN, "duration_s"), ("at_s",)),
    "silent": Kind(SILENT, (*_WHEN, "duration_s"), ("at_s",)),
    "wrong_version": Kind(WRONG_VERSION, ("version",), ()),
    "bus_off": Kind(BUS_OFF, (*_WHEN, "duration_s"), ("at_s",), ("canopen",)),
    "emcy": Kind(EMERGENCY, (*_WHEN, "code"), ("at_s", "code"), ("canopen",)),
    "leave_operation_enabled": Kind(LEAVE_OPERATION_ENABLED, _WHEN, ("at_s",), ("canopen",)),
    "reboot": Kind(REBOOT, (*_WHEN, "off_s"), ("at_s",)),
    "encoder_fault": Kind(ENCODER_FAULT, (*_WHEN, "duration_s"), ("at_s",), ("serial",)),
    "amplifier_fault": Kind(AMPLIFIER_FAULT, (*_WHEN, "duration_s"), ("at_s",), ("serial",)),
    "external_stop": Kind(EXTERNAL_STOP, (*_WHEN, "duration_s"), ("at_s",), ("serial",)),
    "enable_released": Kind(RELEASED, (*_WHEN, "duration_s"), ("at_s",)),
    "measured_current": Kind(MEASURED_CURRENT, (*_WHEN, "duration_s", "factor", "current"), ("at_s",), ("canopen",)),
    "second_node": Kind(SECOND_NODE, (*_WHEN, "counts", "count"), ("at_s", "counts"), ("canopen",)),
    "foreign_sdo": Kind(FOREIGN_SDO, (*_WHEN, "object", "value", "size"), ("at_s", "object", "value"), ("canopen",)),
}


@dataclass(frozen=True)
class Limit:
    """Limits and default of a number in a script, and whether it must be whole."""

    least: float
    most: float
    default: float
    whole: bool = False


NUMBERS = {
    "at_s": Limit(0, LONGEST_S, 0),
    "position": Limit(-math.inf, math.inf, 0),
    "force": Limit(-math.inf, math.inf, 0),
    "counts_offset": Limit(-(2**32), 2**32, 0, whole=True),
    "current_gain": Limit(-1000, 1000, 1),
    "watchdog": Limit(0, 1, 1, whole=True),
    "override": Limit(-(2**31), 2**32 - 1, 0, whole=True),
    "count": Limit(1, 1_000_000, 1, whole=True),
    "delay_s": Limit(1e-6, 60, 1e-3),
    "duration_s": Limit(1e-6, math.inf, math.inf),
    "off_s": Limit(1e-6, 60, 0.1),
    "bytes": Limit(1, 4096, 1, whole=True),
    "counts": Limit(-(2**31), 2**31, 0, whole=True),
    "version": Limit(0, 255, 0xFF, whole=True),
    "code": Limit(1, 0xFFFF, 1, whole=True),
    "factor": Limit(-1000, 1000, 1),
    "current": Limit(-1000, 1000, 0),
    "value": Limit(-(2**31), 2**32 - 1, 0, whole=True),
    "size": Limit(1, 4, 1, whole=True),
}


def to_ns(seconds: float) -> int:
    """Whole ns; FAR_NS for an infinite time."""
    return w.FAR_NS if math.isinf(seconds) else round(seconds * 1e9)


def fault_table(faults: Iterable[Mapping[str, Any]]) -> NDArray[np.int64]:
    """The table of faults for the compiled service, shape (n, FAULT_WORDS), all waiting."""
    rows = [_row(fault) for fault in faults]
    return np.array(rows, np.int64).reshape(len(rows), w.FAULT_WORDS)


def _row(fault: Mapping[str, Any]) -> list[int]:
    row = [0] * w.FAULT_WORDS
    row[w.FAULT_KIND] = KINDS[fault["kind"]].number
    if fault["from"] == SIGNAL:
        row[w.FAULT_STATE] = w.UNSIGNALLED
    else:
        row[w.FAULT_FROM] = fault["from"]
    row[w.FAULT_AT_NS] = to_ns(fault["at_s"])
    row[w.FAULT_FRAMES] = fault.get("frames", 0)
    row[w.FAULT_COUNT] = row[w.FAULT_LEFT] = fault.get("count", 1)
    row[w.FAULT_DELAY_NS] = to_ns(fault.get("delay_s", 0.0))
    row[w.FAULT_DURATION_NS] = to_ns(fault.get("duration_s", fault.get("off_s", 0.0)))
    row[w.FAULT_SIZE] = fault.get("bytes", fault.get("size", 0))
    row[w.FAULT_COUNTS] = fault.get("counts", 0)
    row[w.FAULT_CODE] = fault.get("code", 0)
    index, subindex = fault.get("object", (0, 0))
    row[w.FAULT_OBJECT] = index | subindex << 16
    row[w.FAULT_VALUE] = fault.get("value", 0)
    row[w.FAULT_FACTOR_PPM] = round(fault.get("factor", 1) * 1e6)
    row[w.FAULT_CURRENT_UA] = round(fault.get("current", 0) * 1e6)
    return row
