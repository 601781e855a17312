"""Time for the compiled loop: CLOCK_MONOTONIC through libc, and the arithmetic of (ns, fraction) instants.

An instant is an int64 of nanoseconds plus a float64 fraction in [0, 1). A period such as 1/3 ms is not a whole number of
nanoseconds; in this form a grid of 10⁹ such periods drifts by less than a nanosecond.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from hapticd.jit import njit

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1
_EINTR = 4

_clock_gettime = types.ExternalFunction("clock_gettime", types.intc(types.intc, types.intp))
_clock_nanosleep = types.ExternalFunction("clock_nanosleep", types.intc(types.intc, types.intc, types.intp, types.intp))


@njit(inline=True, counted=False)
def now_ns(timespec: NDArray[Any]) -> int:
    """CLOCK_MONOTONIC in ns; ``timespec`` is an int64[2] scratch buffer."""
    _clock_gettime(_CLOCK_MONOTONIC, timespec.ctypes.data)
    return timespec[0] * 1_000_000_000 + timespec[1]


@njit(inline=True, counted=False)
def sleep_until(timespec: NDArray[Any], instant_ns: int) -> None:
    """Sleep until an absolute CLOCK_MONOTONIC instant, also after a signal."""
    timespec[0] = instant_ns // 1_000_000_000
    timespec[1] = instant_ns - timespec[0] * 1_000_000_000
    while _clock_nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, timespec.ctypes.data, 0) == _EINTR:
        pass


@njit("UniTuple(float64, 2)(float64, float64)", inline=True, counted=False)
def _split(base_frac: float, offset_ns: float) -> tuple[float, float]:
    whole = np.floor(offset_ns)
    frac = base_frac + (offset_ns - whole)
    if frac >= 1.0:
        whole += 1.0
        frac -= 1.0
    return whole, frac


@njit("Tuple((int64, float64))(int64, float64, int64, float64)", inline=True, counted=False)
def grid_instant(base_ns: int, base_frac: float, steps: int, period_ns: float) -> tuple[int, float]:
    """Instant ``base + steps · period`` without losing the fraction of a nanosecond."""
    period_whole = int(np.floor(period_ns))
    period_frac = period_ns - period_whole
    whole, frac = _split(base_frac, steps * period_frac)
    return base_ns + steps * period_whole + int(whole), frac


@njit("Tuple((int64, float64))(int64, float64, float64)", inline=True, counted=False)
def later(ns: int, frac: float, offset_ns: float) -> tuple[int, float]:
    """Instant ``(ns, frac) + offset_ns``."""
    whole, new_frac = _split(frac, offset_ns)
    return ns + int(whole), new_frac
