"""Detection of other senders on the bus, compiled: samples without a SYNC, and SDO frames of another client.

CAN frames do not contain their sender. On a link that forwards only the drive's frames, a TPDO 1 without a SYNC and an SDO
reply without an own request are the only traces of another sender. docs/decisions/0077-somebody-else-on-the-bus.md
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from drivers.canopen import layout as w
from hapticd.jit import njit

# Command bytes of SDO (CiA 301, 7.2.4.3). Only of replies that are unambiguous: segments of a block upload have a number
# here.
_DOWNLOADED = 0x60
_BLOCK_BEGUN = (0xA0, 0xA4)
_SEGMENTS_TAKEN = (0x20, 0x30)
_DOWNLOAD_SEGMENT, _DOWNLOAD, _BLOCK_DOWNLOAD = 0, 1, 6
UNNAMED = -1
"""Instead of an object: the frame belongs to a transfer whose beginning was not received."""


@njit("void(int64[::1], int64, int64)", counted=False)
def lose(s: NDArray[Any], reason: int, detail: int) -> None:
    """Mark the drive as permanently lost; the first reason is kept."""
    if s[w.REASON] == 0:
        s[w.REASON] = reason
        s[w.DETAIL] = detail


@njit("void(int64[::1], int64, int64)", counted=False)
def note(s: NDArray[Any], event: int, detail: int) -> None:
    """Record a temporary error, which ends this tick; the first one is kept."""
    if s[w.EVENT] == 0 and s[w.REASON] == 0:
        s[w.EVENT] = event
        s[w.DETAIL] = detail


@njit("void(int64[::1], int64)", counted=False)
def take_sample(s: NDArray[Any], data: int) -> None:
    """Count a TPDO 1: as the reply to a SYNC, also a late one, or as one without a SYNC."""
    s[w.FRESH] += 1
    if s[w.DUE] > 0:
        s[w.DUE] -= 1
    else:
        s[w.UNASKED] += 1
        s[w.SURPLUS] += w.REPEATED if data == s[w.SAMPLE] else w.CHANGED
    s[w.SAMPLE] = data


@njit("boolean(int64[::1], int64)", counted=False)
def too_many_samples(s: NDArray[Any], now_ns: int) -> bool:
    """At the end of a tick: whether there were more TPDO 1 without a SYNC than repeated frames of a bus explain.

    A late TPDO and the next one in the same tick are the replies to two SYNCs, and not a surplus.
    """
    if s[w.FRESH] == 0:
        s[w.UNANSWERED_NS] = now_ns
    elif now_ns - s[w.UNANSWERED_NS] > w.SURPLUS_NS:
        s[w.DUE] = 0  # missing replies are lost, not late
    if s[w.SURPLUS] >= w.SURPLUS_LIMIT:
        s[w.SURPLUS] = 0
        return True
    if s[w.SURPLUS] == 0:
        s[w.SURPLUS_SINCE_NS] = now_ns
    elif now_ns - s[w.SURPLUS_SINCE_NS] > w.SURPLUS_NS:
        s[w.SURPLUS] = 0
    return False


@njit("void(int64[::1], int64)", counted=False)
def foreign_answer(s: NDArray[Any], data: int) -> None:
    """An SDO reply of our drive to another client: a confirmed write is an error, everything else is counted."""
    command = data & 0xFF
    if command == _DOWNLOADED or command in _BLOCK_BEGUN:
        lose(s, w.LOST_WRITTEN, (data >> 8) & 0xFFFFFF)
    elif data in _SEGMENTS_TAKEN:
        lose(s, w.LOST_WRITTEN, UNNAMED)
    else:
        s[w.SDO_SEEN] += 1


@njit("void(int64[::1], int64)", counted=False)
def foreign_request(s: NDArray[Any], data: int) -> None:
    """An SDO request of another client to our drive: a write is an error, everything else is counted."""
    kind = (data & 0xFF) >> 5
    if kind == _DOWNLOAD or (kind == _BLOCK_DOWNLOAD and data & 1 == 0):
        lose(s, w.LOST_WRITTEN, (data >> 8) & 0xFFFFFF)
    elif kind in (_DOWNLOAD_SEGMENT, _BLOCK_DOWNLOAD):
        lose(s, w.LOST_WRITTEN, UNNAMED)
    else:
        s[w.SDO_SEEN] += 1
