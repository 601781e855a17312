"""The row of a run file: one row a servo tick, its columns, their units and the bits of ``flags``.

Pure numpy, so that the servo ring, the simulator and the readers share one layout without importing Arrow. Every field
is eight bytes wide: a block of rows is also an int64 matrix of shape (rows, 10), which is how it becomes columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROW = np.dtype(
    [
        ("tick", np.int64),
        ("time_s", np.float64),
        ("encoder_counts", np.int64),
        ("ticks", np.int64),
        ("current_command_A", np.float64),
        ("current_measured_A", np.float64),
        ("force_command", np.float64),
        ("wake_late_ns", np.int64),
        ("exec_ns", np.int64),
        ("flags", np.int64),
    ],
    align=True,
)

Rows = NDArray[np.void]

FLAG_RUNNING = 1
FLAG_CLAMPED = 2
FLAG_MISSED_PERIOD = 4
FLAG_MISSED_EXCHANGE = 8
FLAG_EXCITATION = 16
FLAG_FAULT = 32
FLAG_HELD = 64
FLAG_SATURATED = 128
FLAG_DROPPED = 256

FLAG_MEANINGS = {
    FLAG_RUNNING: "the spring is rendered (state running)",
    FLAG_CLAMPED: "the safety gate reduced the requested current",
    FLAG_MISSED_PERIOD: "periods were skipped before this tick",
    FLAG_MISSED_EXCHANGE: "the driver's exchange failed in this tick",
    FLAG_EXCITATION: "an excitation was added to the command",
    FLAG_FAULT: "a fault is latched",
    FLAG_HELD: "the previous command was held",
    FLAG_SATURATED: "the converter was at the end of its range",
    FLAG_DROPPED: "rows before this one were lost: the recorder had no room for them",
}


@dataclass(frozen=True)
class Column:
    """One column of a run file; ``linear_unit`` differs from ``unit`` where a linear device does."""

    name: str
    unit: str
    description: str
    linear_unit: str | None = None

    def unit_for(self, *, linear: bool) -> str:
        """Unit on a rotary or a linear device."""
        return self.linear_unit if linear and self.linear_unit is not None else self.unit


COLUMNS = (
    Column("tick", "1", "number of the servo tick"),
    Column("time_s", "s", "time at which the tick was due, from the start of the servo loop"),
    Column(
        "encoder_counts",
        "count",
        "encoder position read in this tick, counted as encoder.invert says, before any decimation",
    ),
    Column("ticks", "coarse tick", "decimated position from the spring's origin, as the spring saw it, with dither"),
    Column("current_command_A", "A", "current commanded to the amplifier in this tick, after limits and quantisation"),
    Column("current_measured_A", "A", "current reported by the driver in this tick; NaN where it reports none"),
    Column("force_command", "N m", "torque or force asked for by the spring, before limits", "N"),
    Column("wake_late_ns", "ns", "how much later than due the loop woke"),
    Column("exec_ns", "ns", "time from waking to the end of the tick's work"),
    Column("flags", "bits", "; ".join(f"{bit}: {meaning}" for bit, meaning in FLAG_MEANINGS.items())),
)


def empty_rows(count: int = 0) -> Rows:
    """``count`` rows of zeros."""
    return np.zeros(count, dtype=ROW)


def joined(*parts: Rows) -> Rows:
    """Rows one after the other, in memory of their own: as words, which is several times as fast as field by field."""
    return np.concatenate([part.view(np.int64) for part in parts]).view(ROW)


def check_rows(rows: NDArray[Any]) -> None:
    """Refuse anything that is not a one-dimensional array of `ROW`.

    Raises:
        TypeError: another dtype or number of dimensions.
    """
    if rows.dtype != ROW or rows.ndim != 1:
        raise TypeError(f"rows must be a one-dimensional array of record.ROW, not {rows.dtype} of shape {rows.shape}")
