"""A step of the shaft's motion: phase after phase, with the device's friction (stiction or bristle)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.jit import njit
from hapticd.plant._bristle import slide_on_bristle
from hapticd.plant._slide import FORCES, Forces, slide
from hapticd.plant.effect_terms import has_bristle

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_p = types.Array(_f8, 1, "C")

MOST_PHASES = 20_000
"""Most phases of a step: only an oscillation of thousands of periods, which has decayed, has more."""


@njit(types.UniTuple(_f8, 4)(_p, _f8, _f8, _f8, _f8, FORCES), counted=False)
def phase(p: NDArray[Any], x: float, v: float, z: float, span: float, on: Forces) -> tuple[float, float, float, float]:
    """Move the shaft through one phase with the device's friction; as `slide_on_bristle`."""
    if has_bristle(p):
        return slide_on_bristle(p, x, v, z, span, on)
    x, v, time = slide(p, x, v, span, on)
    return x, v, z, time


@njit(types.UniTuple(_f8, 3)(_p, _f8, _f8, _f8, _f8, FORCES), counted=False)
def move(p: NDArray[Any], x: float, v: float, z: float, span: float, on: Forces) -> tuple[float, float, float]:
    """Move the shaft through all the phases of a step; arguments as in `slide_on_bristle`.

    Returns:
        Position, velocity and bristle deflection after `span`.
    """
    remaining = span
    for _ in range(MOST_PHASES):
        x, v, z, time = phase(p, x, v, z, remaining, on)
        remaining -= time
        if not remaining > 0.0:
            break
    return x, v, z
