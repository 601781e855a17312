"""Boundary of a criterion: a bracketed root, moved to the side on which the criterion holds."""

from __future__ import annotations

import math
from collections.abc import Callable

from scipy.optimize import brentq

_SMALLEST = 5e-324
_FINEST = 4.0 * 2.0**-52
"""Smallest relative tolerance that `brentq` accepts."""
_STEPS = 5000
"""Enough for a function of which only the sign is known: each step then halves the bracket, down to its last bits."""


def boundary(margin: Callable[[float], float], good: float, bad: float) -> float:
    """The value nearest to `bad` at which a margin is ≥ 0, to the last bit; the margin changes its sign once.

    Args:
        margin: of a criterion; ±1 is enough, but takes more steps.
        good: where it is ≥ 0.
        bad: where it is below 0.

    Raises:
        ValueError: the margin has the same sign at both ends, or is NaN between them.
    """
    value = float(brentq(margin, good, bad, xtol=_SMALLEST, rtol=_FINEST, maxiter=_STEPS))
    while margin(value) < 0.0:
        value = math.nextafter(value, good)
    while margin(further := math.nextafter(value, bad)) >= 0.0:
        value = further
    return value
