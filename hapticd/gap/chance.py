"""Student's distribution: what chance does to a statistic that blocks of the recordings tell."""

from __future__ import annotations

from scipy.special import stdtr, stdtrit


def standard_errors(probability: float, blocks: int) -> float:
    """Standard errors that chance exceeds with a probability."""
    return -float(stdtrit(blocks - 1, probability))


def exceeding(errors: float, blocks: int) -> float:
    """Probability with which chance exceeds a number of standard errors."""
    return float(stdtr(blocks - 1, -errors))
