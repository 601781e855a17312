"""Rows as frames for a live view: a header and columns of four bytes a value, little-endian, made to be drawn.

A frame holds at most a portion of the recorder's. ``first_row`` counts every row that the servo loop has made, also those
that no receiver saw: whoever gets a frame knows how many rows are missing before it, wherever on the way they were lost,
and nobody on the way has to look inside.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from hapticd.record.schema import FLAG_EXCITATION, FLAG_FAULT, FLAG_RUNNING, Rows, empty_rows

MAGIC = 0x31465348
"""``HSF1``."""

HEADER = struct.Struct("<IIqqIIdddq")
"""magic, rows, first_row, first tick, settings epoch, decimation, first time_s, period in s, Unix time, origin."""

PREFIX = struct.Struct("<I")
"""Bytes of the frame that follows, before each frame of a stream."""

LONGEST_FRAME = 1 << 20

COLUMNS = (
    ("tick_offset", "<i4"),
    ("time_offset_s", "<f4"),
    ("counts", "<i4"),
    ("ticks", "<i4"),
    ("current_A", "<f4"),
    ("current_measured_A", "<f4"),
    ("force", "<f4"),
    ("late_us", "<f4"),
    ("flags", "<i4"),
)
"""After the header, one block of ``rows`` values each. ``counts`` are raw counts from the header's origin."""

ROW_BYTES = 4 * len(COLUMNS)
_FLAGS = struct.Struct("<i")
"""Of the newest row: the last value of the last column."""
_STATE = FLAG_RUNNING | FLAG_FAULT | FLAG_EXCITATION
_INT32 = np.iinfo(np.int32)


@dataclass(frozen=True)
class Context:
    """What a frame says besides its rows.

    Attributes:
        first_row: number of the first row among all rows since the servo loop began.
        epoch: number of the settings in force.
        decimation: raw counts in a coarse tick.
        period_s: servo period, s.
        origin_counts: raw count of the spring's origin.
        unix_s: Unix time at which the newest row was taken from the ring.
    """

    first_row: int
    epoch: int
    decimation: int
    period_s: float
    origin_counts: int
    unix_s: float


def encode(rows: Rows, context: Context) -> bytes:
    """One frame; with no rows, a sign of life.

    Args:
        rows: shape (n,) of `schema.ROW`.
        context: what goes into the header.
    """
    count = len(rows)
    tick = int(rows["tick"][0]) if count else 0
    time_s = float(rows["time_s"][0]) if count else 0.0
    header = HEADER.pack(
        MAGIC,
        count,
        context.first_row,
        tick,
        context.epoch,
        context.decimation,
        time_s,
        context.period_s,
        context.unix_s,
        context.origin_counts,
    )
    integers = np.empty((len(COLUMNS), count), "<i4")
    floats = integers.view("<f4")
    with np.errstate(over="ignore"):
        integers[0] = rows["tick"] - tick
        floats[1] = rows["time_s"] - time_s
        # Beyond 32 bits it stands at the end of the range: a shaft that far away is a fault long since.
        (rows["encoder_counts"] - context.origin_counts).clip(_INT32.min, _INT32.max, integers[2], casting="unsafe")
        rows["ticks"].clip(_INT32.min, _INT32.max, integers[3], casting="unsafe")
        floats[4] = rows["current_command_A"]
        floats[5] = rows["current_measured_A"]
        floats[6] = rows["force_command"]
        floats[7] = rows["wake_late_ns"] * 1e-3
        integers[8] = rows["flags"]
    return header + integers.tobytes()


def standing(frame: bytes) -> tuple[int, int] | None:
    """Settings epoch and, by its flags, the loop's state at a frame's newest row; None where there is no row."""
    if len(frame) < HEADER.size + ROW_BYTES:
        return None
    _, _, _, _, epoch, *_ = HEADER.unpack_from(frame)
    flags: int = _FLAGS.unpack_from(frame, len(frame) - _FLAGS.size)[0]
    return epoch, flags & _STATE


def decode(frame: bytes) -> tuple[Rows, Context]:
    """Rows and context of one frame; what a frame does not carry (``exec_ns``) is zero.

    Raises:
        ValueError: it is no frame, or cut short.
    """
    if len(frame) < HEADER.size:
        raise ValueError(f"a frame has at least {HEADER.size} bytes, this has {len(frame)}")
    magic, count, first_row, tick, epoch, decimation, time_s, period_s, unix_s, origin = HEADER.unpack_from(frame)
    if magic != MAGIC or len(frame) != HEADER.size + count * ROW_BYTES:
        raise ValueError(f"not a frame: magic {magic:#x}, {count} rows in {len(frame)} bytes")
    parts = {}
    for index, (name, kind) in enumerate(COLUMNS):
        parts[name] = np.frombuffer(frame, kind, count, HEADER.size + 4 * count * index)
    rows = empty_rows(count)
    rows["tick"] = tick + parts["tick_offset"].astype(np.int64)
    rows["time_s"] = time_s + parts["time_offset_s"].astype(np.float64)
    rows["encoder_counts"] = origin + parts["counts"].astype(np.int64)
    rows["ticks"] = parts["ticks"]
    rows["current_command_A"] = parts["current_A"]
    rows["current_measured_A"] = parts["current_measured_A"]
    rows["force_command"] = parts["force"]
    rows["wake_late_ns"] = np.round(parts["late_us"].astype(np.float64) * 1e3)
    rows["flags"] = parts["flags"]
    return rows, Context(first_row, epoch, decimation, period_s, origin, unix_s)
