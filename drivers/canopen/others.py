"""What shows that somebody else is on the bus: samples that no SYNC asked for, and SDO that is not ours; compiled.

CAN frames carry no sender. A TPDO 1 that came without a SYNC, and an SDO answer without a question of ours, are all that a
third party leaves behind on a link that passes on only what the drive sends. docs/decisions/0077-somebody-else-on-the-bus.md
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from drivers.canopen import layout as w
from hapticd.jit import njit

# Command bytes of SDO (CiA 301, 7.2.4.3). The answers stand for themselves: segments of a block upload carry a number here.
_DOWNLOADED = 0x60
_BLOCK_BEGUN = (0xA0, 0xA4)
_SEGMENTS_TAKEN = (0x20, 0x30)
_DOWNLOAD_SEGMENT, _DOWNLOAD, _BLOCK_DOWNLOAD = 0, 1, 6
UNNAMED = -1
"""In place of an object: the frame belongs to a transfer whose beginning was not seen."""


@njit("void(int64[::1], int64, int64)", counted=False)
def lose(s: NDArray[Any], reason: int, detail: int) -> None:
    """The drive is lost for good; the first reason is kept."""
    if s[w.REASON] == 0:
        s[w.REASON] = reason
        s[w.DETAIL] = detail


@njit("void(int64[::1], int64, int64)", counted=False)
def note(s: NDArray[Any], event: int, detail: int) -> None:
    """Something went wrong that ends this tick, and may pass; the first is kept."""
    if s[w.EVENT] == 0 and s[w.REASON] == 0:
        s[w.EVENT] = event
        s[w.DETAIL] = detail


@njit("void(int64[::1], int64)", counted=False)
def take_sample(s: NDArray[Any], data: int) -> None:
    """Count a TPDO 1: as the answer to a SYNC, however late, or as one that none asked for."""
    s[w.FRESH] += 1
    if s[w.DUE] > 0:
        s[w.DUE] -= 1
    else:
        s[w.UNASKED] += 1
        s[w.SURPLUS] += w.REPEATED if data == s[w.SAMPLE] else w.CHANGED
    s[w.SAMPLE] = data


@njit("boolean(int64[::1], int64)", counted=False)
def too_many_samples(s: NDArray[Any], now_ns: int) -> bool:
    """At the end of a tick: whether more TPDO 1 have come without a SYNC than a bus that repeats a frame explains.

    A late TPDO and the next one in the same tick are the answers to two SYNCs, and no surplus.
    """
    if s[w.FRESH] == 0:
        s[w.UNANSWERED_NS] = now_ns
    elif now_ns - s[w.UNANSWERED_NS] > w.SURPLUS_NS:
        s[w.DUE] = 0  # what was to come is lost, not late
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
    """An SDO answer of our drive that we did not ask for: a write that it confirms is the end, all else is counted."""
    command = data & 0xFF
    if command == _DOWNLOADED or command in _BLOCK_BEGUN:
        lose(s, w.LOST_WRITTEN, (data >> 8) & 0xFFFFFF)
    elif data in _SEGMENTS_TAKEN:
        lose(s, w.LOST_WRITTEN, UNNAMED)
    else:
        s[w.SDO_SEEN] += 1


@njit("void(int64[::1], int64)", counted=False)
def foreign_request(s: NDArray[Any], data: int) -> None:
    """An SDO request to our drive, which is never ours: a write is the end, all else is counted."""
    kind = (data & 0xFF) >> 5
    if kind == _DOWNLOAD or (kind == _BLOCK_DOWNLOAD and data & 1 == 0):
        lose(s, w.LOST_WRITTEN, (data >> 8) & 0xFFFFFF)
    elif kind in (_DOWNLOAD_SEGMENT, _BLOCK_DOWNLOAD):
        lose(s, w.LOST_WRITTEN, UNNAMED)
    else:
        s[w.SDO_SEEN] += 1
