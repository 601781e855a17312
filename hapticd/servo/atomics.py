"""The atomics that two threads share: indices into an int64 array that the loop and Python read and write atomically.

Each is written by one side only. Those of different writers are eight words, one cache line, apart. The rest of the
loop's memory is in its records (`hapticd.servo.layout`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Written by the supervisor.
SEQUENCE: Final = 0
"""Number of the newest parameter set."""
HEARTBEAT_NS: Final = 8
"""Time of the supervisor's last heartbeat, CLOCK_MONOTONIC, ns."""
STOP: Final = 9
"""Not 0: command zero current, then leave the loop."""

# Written by the recorder.
RING_TAIL: Final = 16
"""Rows taken."""

# Written by the loop.
RING_HEAD: Final = 24
"""Rows recorded."""
DROPPED: Final = 25
"""Rows lost because the ring was full."""
MODE: Final = 26
"""OFF, READY, RUNNING or FAULT."""
APPLIED: Final = 27
"""Number of the parameter set in force."""
FAULT_CODE: Final = 28
"""Of `hapticd.servo.faults`; 0 for none. Its value and limit are stored before it."""
FAULT_TICK: Final = 29
"""Tick in which it was raised."""
TICKS: Final = 30
"""Ticks done."""
MISSED_PERIODS: Final = 31
"""Periods that were skipped."""
MISSED_EXCHANGES: Final = 32
"""Ticks whose exchange with the device failed."""
CLAMPED: Final = 33
"""Commands beyond the peak current."""
EXCITATION_DONE: Final = 34
"""Number of the last excitation that ran to its end."""
LATE_MAX_NS: Final = 36
"""Largest lateness, ns."""
EXEC_MAX_NS: Final = 37
"""Longest tick, ns."""
COUNTS: Final = 39
"""Encoder counts of the last good sample."""
FAULT_VALUE: Final = 41
"""Bits of a float64: what tripped the fault. Not in the snapshot, because the flight recorder stores the atomics only."""
FAULT_LIMIT: Final = 42
"""Bits of a float64: the limit that was exceeded."""
I2T: Final = 43
"""Bits of a float64: I²t above the continuous current, A² s; here, so that it survives the process."""
HELD: Final = 44
"""1: in the last good exchange the device reported that its enable input is held."""
DEVICE_LOST: Final = 40
"""1: the driver has reported its device as lost; 0 when the fault is cleared."""

SIZE: Final = 48
"""Words in all."""


def fault_numbers(shared: NDArray[Any]) -> tuple[float, float]:
    """The value that tripped the fault, and its limit.

    Args:
        shared: the atomics, shape (SIZE,), int64.
    """
    value, limit = shared[FAULT_VALUE : FAULT_LIMIT + 1].view(np.float64)
    return float(value), float(limit)


def heat(shared: NDArray[Any]) -> float:
    """I²t above the continuous current, A² s; infinite if the word is not a valid number.

    Args:
        shared: the atomics, int64; those of a flight recorder may be fewer.
    """
    i2t = float(shared[I2T : I2T + 1].view(np.float64)[0]) if shared.size > I2T else 0.0
    return i2t if i2t >= 0.0 else math.inf
