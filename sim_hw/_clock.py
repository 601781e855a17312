"""CLOCK_MONOTONIC and descriptors in compiled code."""

from __future__ import annotations

from typing import Any

from numba import types
from numpy.typing import NDArray

from hapticd.jit import njit

_CLOCK_MONOTONIC = 1

_clock_gettime = types.ExternalFunction("clock_gettime", types.intc(types.intc, types.intp))
_ppoll = types.ExternalFunction("ppoll", types.intc(types.intp, types.uintp, types.intp, types.intp))
read = types.ExternalFunction("read", types.intp(types.intc, types.intp, types.uintp))
write = types.ExternalFunction("write", types.intp(types.intc, types.intp, types.uintp))

POLLIN, POLLERR, POLLHUP = 1, 8, 16


@njit("int64(int64[::1])", counted=False)
def monotonic_ns(timespec: NDArray[Any]) -> int:
    """CLOCK_MONOTONIC in ns; ``timespec`` is an int64[2] scratch buffer."""
    _clock_gettime(_CLOCK_MONOTONIC, timespec.ctypes.data)
    return timespec[0] * 1_000_000_000 + timespec[1]


@njit("int64(int64[::1], int64, int64[::1], int64)", counted=False)
def wait_readable(pollfds: NDArray[Any], count: int, timespec: NDArray[Any], wait_ns: int) -> int:
    """``ppoll`` for at most ``wait_ns``; returns the number of descriptors with events, negative on a signal.

    Args:
        pollfds: ``struct pollfd`` words, see :func:`pollfd`. count: their number.
        timespec: scratch, int64[2]. wait_ns: ns; less than 0 counts as 0.
    """
    wait_ns = max(wait_ns, 0)
    timespec[0] = wait_ns // 1_000_000_000
    timespec[1] = wait_ns - timespec[0] * 1_000_000_000
    return _ppoll(pollfds.ctypes.data, count, timespec.ctypes.data, 0)


@njit("int64(int64, int64)", inline=True, counted=False)
def pollfd(descriptor: int, events: int) -> int:
    """A little-endian ``struct pollfd`` as one word: int fd, short events, short revents = 0."""
    return (descriptor & 0xFFFFFFFF) | (events << 32)


@njit("int64(int64)", inline=True, counted=False)
def returned_events(word: int) -> int:
    """``revents`` of a ``struct pollfd`` word."""
    return (word >> 48) & 0xFFFF
