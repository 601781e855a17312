"""A load that is not rigidly on the shaft: play, or a spring between."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.candidates.build import Scalar, promising, scalar_term

if TYPE_CHECKING:
    from hapticd.gap.context import Context
    from hapticd.gap.hypothesis import Term


def backlash(context: Context) -> list[Term]:
    """Play of width `gap` between motor and load, from half a resolution to half of what the shaft travels."""
    low, high = 0.5 * context.resolution, 0.5 * context.span
    terms = [
        scalar_term(
            "backlash",
            Scalar("gap", float(gap), low, high, True),
            Scalar("load_share", 0.4, 0.02, 0.98),
            Scalar("restitution", rebound, 0.0, 0.9),
        )
        for gap in np.array([3.0, 6.0, 12.0, 25.0, 50.0, 100.0]) * context.resolution
        if low < gap < high
        for rebound in (0.0, 0.45)
    ]
    return promising(context, terms)


def flexible_coupling(context: Context) -> list[Term]:
    """Load on a spring and damper, with its anti-resonance above one a window and below a quarter of the sampling rate."""
    low, high = 0.5 / context.window_s, 0.25 / context.period
    return [
        scalar_term(
            "flexible_coupling",
            Scalar("f_r", float(f), low, high, True),
            Scalar("load_share", 0.4, 0.02, 0.98),
            Scalar("damping", 0.05, 1e-3, 1.5, True),
        )
        for f in np.geomspace(1.5 * low, 0.5 * high, 5)
    ]
