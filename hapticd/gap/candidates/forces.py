"""Forces that act whether the shaft moves or not: bias, gravity, a spring."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.candidates.build import Scalar, scalar_term
from hapticd.gap.hypothesis import Coordinate, Term
from hapticd.plant.layout import word

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.context import Context

    Floats = NDArray[np.float64]


def constant_bias(context: Context) -> list[Term]:
    """+ τ₀."""
    limit = 10.0 * context.force_scale
    return [scalar_term("constant_bias", Scalar("tau_0", 0.0, -limit, limit))]


def gravity(context: Context) -> list[Term]:
    """− m·g·l·sin(θ − θ₀), fitted as p·cos θ − q·sin θ with q = m g l cos θ₀, p = m g l sin θ₀."""
    size, angle = word("gravity.m_g_l"), word("gravity.theta_0")
    limit = 10.0 * context.force_scale

    def parameters(u: Floats) -> dict[str, float]:
        return {"m_g_l": float(np.hypot(u[0], u[1])), "theta_0": float(np.arctan2(u[1], u[0]))}

    def write(vector: Floats, u: Floats) -> None:
        vector[size], vector[angle] = parameters(u).values()

    coordinates = tuple(Coordinate(name, -limit, limit, 1e-3 * limit) for name in ("in_phase", "quadrature"))
    return [Term("gravity", coordinates, write, parameters, (0.0, 0.0))]


def return_spring(context: Context) -> list[Term]:
    """− k_s·(θ − θ₀) with θ₀ no further outside the recorded range than this range is wide: beyond, it is a bias."""
    low, high = context.lowest - context.span, context.highest + context.span
    limit = 20.0 * context.force_scale / max(context.span, context.resolution)
    middle = 0.5 * (context.lowest + context.highest)
    return [
        scalar_term("return_spring", Scalar("k_s", 0.003 * limit, 0.0, limit), Scalar("theta_0", start, low, high))
        for start in (middle, context.lowest, context.highest)
    ]
