"""Timing statistics: a logarithmic histogram filled by the loop, whose quantiles can be read while it runs.

A bucket is 1/32 of a power of two wide, so a quantile is accurate to about 3 %; the maximum is stored exactly.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.jit import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

SUB_BITS = 5
_SUB = 1 << SUB_BITS
BUCKETS = _SUB * 40


@njit(counted=False)
def count(histogram: NDArray[Any], value_ns: int) -> None:
    """Add one value in ns (a negative one to the first bucket, one above 2⁴³ ns to the last)."""
    value = max(value_ns, 0)
    exponent = SUB_BITS
    while exponent < 43 and (value >> (exponent + 1)) > 0:
        exponent += 1
    if value < _SUB:
        index = value
    else:
        index = (exponent - SUB_BITS + 1) * _SUB + ((value >> (exponent - SUB_BITS)) & (_SUB - 1))
    histogram[min(index, BUCKETS - 1)] += 1


@functools.cache
def bucket_edges() -> NDArray[np.float64]:
    """Lower edge of every bucket and the upper edge of the last, ns, shape (BUCKETS + 1,), read-only."""
    index = np.arange(BUCKETS + 1)
    octave, position = np.divmod(index, _SUB)
    edges = np.where(octave == 0, position, (_SUB + position) * 2.0 ** (octave - 1)).astype(np.float64)
    edges.flags.writeable = False
    return edges


def quantiles_us(histogram: NDArray[np.int64], maximum_ns: int) -> dict[str, float | None]:
    """``p50``, ``p99``, ``p999`` and ``max`` in µs; None for each if nothing was counted."""
    total = int(histogram.sum())
    if total == 0:
        return {"p50": None, "p99": None, "p999": None, "max": None}
    edges = bucket_edges()
    cumulative = np.cumsum(histogram)

    def quantile(q: float) -> float:
        index = int(np.searchsorted(cumulative, q * total))
        middle = 0.5 * (edges[index] + edges[index + 1])
        return round(min(float(middle), float(maximum_ns)) / 1e3, 3)

    return {"p50": quantile(0.5), "p99": quantile(0.99), "p999": quantile(0.999), "max": round(maximum_ns / 1e3, 3)}
