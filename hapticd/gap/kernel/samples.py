"""What was recorded, as the kernels take it."""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import types
from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")


class Samples(NamedTuple):
    """n samples, and the motor current after each.

    Attributes:
        resolution: width of a cell [rad or m], > 0.
        time_s: (n,) instants [s].
        cell: (n,) lower edge of each sample's cell over the resolution.
        begins: (n,) whether a sample is the first of a stretch, with a new initial state.
        duration: (n, parts) of the parts of each period [s].
        current: (n, parts) motor current in them [A].
        spread: (n, parts) standard deviation of that current [A], from commands that may have been lost.
    """

    resolution: float
    time_s: NDArray[Any]
    cell: NDArray[Any]
    begins: NDArray[Any]
    duration: NDArray[Any]
    current: NDArray[Any]
    spread: NDArray[Any]


SAMPLES = types.NamedTuple((_f8, _a, _a, types.Array(types.boolean, 1, "C"), _m, _m, _m), Samples)
