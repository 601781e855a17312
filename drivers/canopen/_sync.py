"""SYNC of a producer on the bus, which the loop follows, and its samples; compiled."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from drivers.canopen import layout as w
from drivers.canopen._others import note
from hapticd.jit import njit


@njit("void(int64[::1])", counted=False)
def begin_sample(s: NDArray[Any]) -> None:
    """Begin a new sample: all earlier frames belong to an earlier SYNC."""
    s[w.HELD_FRESH] = 0
    if s[w.FRESH] > 0:
        s[w.STALE] += s[w.FRESH]
        s[w.FRESH] = 0
        s[w.OWED] = 0


@njit("void(int64[::1])", counted=False)
def take_sync(s: NDArray[Any]) -> None:
    """Process a SYNC of the producer. TPDOs have no number: the next one is taken as that of this SYNC."""
    s[w.SYNCS] += 1
    begin_sample(s)
    s[w.DUE] = 1


@njit("boolean(int64[::1], int64, int64, float64)", counted=False)
def sync_came(s: NDArray[Any], now_ns: int, expected_ns: int, period_ns: float) -> bool:
    """Whether a SYNC for a tick has come; repeated SYNC more than half a period early mean two producers."""
    if s[w.SYNCS] == 0:
        return False
    s[w.SYNCS] = 0
    if now_ns >= expected_ns - 0.5 * period_ns:
        return True
    if now_ns - s[w.SYNC_SURPLUS_SINCE_NS] > w.SURPLUS_NS:
        s[w.SYNC_SURPLUS] = 0
        s[w.SYNC_SURPLUS_SINCE_NS] = now_ns
    s[w.SYNC_SURPLUS] += 1
    if s[w.SYNC_SURPLUS] >= w.SURPLUS_LIMIT:
        note(s, w.EVENT_SYNCS, s[w.SYNC_SURPLUS])
        s[w.SYNC_SURPLUS] = 0
    return False
