"""Effects between the command and the motor's current."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.candidates.build import Scalar, promising, scalar_term

if TYPE_CHECKING:
    from hapticd.gap.context import Context
    from hapticd.gap.hypothesis import Term

_DELAYS = 12
_LONGEST_DELAY = 200.0
"""In ticks: beyond, a lab sees it with the naked eye."""


def transport_delay(context: Context) -> list[Term]:
    """i(t − T_d). The command of the whole recording is known, so the delay may be longer than a window."""
    high = _LONGEST_DELAY * context.period
    delays = context.period * np.geomspace(0.25, 0.7 * _LONGEST_DELAY, _DELAYS)
    terms = [scalar_term("transport_delay", Scalar("t_d", float(delay), 0.0, high)) for delay in delays]
    return promising(context, terms)


def amplifier_lag(context: Context) -> list[Term]:
    """Second-order lag; its low-frequency delay is 2δ/ω_a. Far above the Nyquist frequency it is no lag at all.

    The current loop runs through the whole recording, so it may be slower than a window is long.
    """
    low, high = max(2.0 / context.duration, 1.0 / (_LONGEST_DELAY * context.period)), 4.0 / context.period
    terms = [
        scalar_term(
            "amplifier_lag",
            Scalar("f_a", float(f), low, high, True),
            Scalar("delta", 0.7, 0.05, 5.0, True),
        )
        for f in np.geomspace(1.5 * low, 0.7 / context.period, _DELAYS)
    ]
    return promising(context, terms)


def current_saturation(context: Context) -> list[Term]:
    """clip(i, ±i_max): only below the largest command is there anything to see."""
    size = np.abs(context.current)
    high = float(size.max())
    if high <= 0.0:
        return []
    starts = np.unique(np.quantile(size, (0.9, 0.99)))
    starts = np.unique([*starts, 0.8 * high])
    return [
        scalar_term("current_saturation", Scalar("i_max", float(s), 0.02 * high, high, True))
        for s in starts
        if 0.02 * high < s < high
    ]
