"""Student's distribution, for statistics estimated from blocks."""

from __future__ import annotations

from scipy.special import stdtr, stdtrit


def standard_errors(probability: float, blocks: int) -> float:
    """The number of standard errors that is exceeded by chance with this probability."""
    return -float(stdtrit(blocks - 1, probability))


def exceeding(errors: float, blocks: int) -> float:
    """Probability to exceed this number of standard errors by chance."""
    return float(stdtr(blocks - 1, -errors))
