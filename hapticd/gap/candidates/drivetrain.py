"""A load that is not rigidly on the shaft: play, or a spring between."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.candidates.build import Scalar, promising, scalar_term
from hapticd.gap.candidates.resonance import Resonance, resonances

if TYPE_CHECKING:
    from hapticd.gap.context import Context
    from hapticd.gap.hypothesis import Term


_GAPS, _REBOUNDS, _USUAL_SHARE, _LOAD_SHARES = 10, (0.0, 0.4), 0.4, (0.15, 0.4, 0.7)
_SEEN, _STARTS = 2, 3
"""Resonances that the spectrum shows, and starts from which a coupling is fitted."""
_TRIED = 30.0
"""Resonances that differ by more than their width, in the band that is looked through."""


def backlash(context: Context) -> list[Term]:
    """Play of width `gap` between motor and load, from half a resolution to half of what the shaft travels.

    A load that rebounds comes back as early as from a smaller gap, so both ways are tried, each with the gap and share of
    the load that predict best from afar.
    """
    low, high = 0.5 * context.resolution, 0.5 * context.span

    def term(gap: float, share: float, rebound: float) -> Term:
        return scalar_term(
            "backlash",
            Scalar("gap", gap, low, high, True),
            Scalar("load_share", share, 0.02, 0.98),
            Scalar("restitution", rebound, 0.0, 0.9),
            is_rugged=True,
        )

    gaps = [float(gap) for gap in np.geomspace(2.0, 200.0, _GAPS) * context.resolution if low < gap < high]
    starts = []
    for rebound in _REBOUNDS:
        likely = [
            float(t.parameters(np.array(t.start))["gap"])
            for t in promising(context, [term(gap, _USUAL_SHARE, rebound) for gap in gaps])
        ]
        starts += promising(context, [term(gap, share, rebound) for gap in likely for share in _LOAD_SHARES], 1)
    return starts


def flexible_coupling(context: Context) -> list[Term]:
    """Load on a spring and damper, with its anti-resonance above one a window and below a quarter of the sampling rate."""
    low, high = 0.5 / context.window_s, 0.25 / context.period
    seen = resonances(context, low, high, _SEEN)
    seen += [Resonance(float(f), 0.05, 0.4) for f in np.geomspace(1.5 * low, 0.5 * high, 5)]
    terms = [
        scalar_term(
            "flexible_coupling",
            Scalar("f_r", at.f_r, low, high, True),
            Scalar("load_share", at.load_share, 0.02, 0.98),
            Scalar("damping", at.damping, 1e-3, 1.5, True),
            trials=_TRIED,
        )
        for at in seen
    ]
    return promising(context, terms, _STARTS)
