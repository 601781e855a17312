"""A coarse digital-to-analogue converter, whose step is looked for and not fitted.

The loss is a staircase in q as the current is one in time: flat where no command of the recording changes its step, with
cliffs where a command that was held for long does. Derivatives say nothing, and a fit that creeps down a tread ends at its
edge, where the least change of q falls off. So all q are compared, and the middle of the best tread is taken.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.evidence import MINIMUM_GAIN
from hapticd.gap.hypothesis import Term
from hapticd.plant.layout import word

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.context import Context

    Floats = NDArray[np.float64]

_Q = word("dac_quantization.q")
_STEPS, _AT_ONCE, _SIMULATED, _REFINED = 4000, 500, 16, 3
"""Neighbours on the grid differ by 0.14 %: at three hundred steps of q the staircase is half a step out of place."""
_FINER = np.linspace(-1.5, 1.5, 13)
_FINEST = np.linspace(-0.7, 0.7, 57)
"""Places around a q, in steps of the grid: first to find its tread, then to see how far it goes."""
_LIKELY = 4.0
_SHARE = 0.5
"""A q is as likely as the best when it loses no more than chance (95 %) and half of the smallest gain that counts."""


def dac_quantization(context: Context) -> list[Term]:
    """i → q·round(i/q). The linear response says which of all q are worth a simulation."""
    high = float(np.quantile(np.abs(context.current), 0.99))
    if high <= 0.0:
        return []
    grid = np.geomspace(high / 300.0, high, _STEPS)
    ratio = float(grid[1] / grid[0])

    def losses(steps: Floats) -> Floats:
        return np.array([context.loss_with(_term(float(q), 0.0), np.zeros(0)) for q in steps])

    likely = _likely(context, grid)
    likely = likely[np.argsort(losses(likely))[:_REFINED]]
    terms = []
    for q in likely:
        around = q * ratio**_FINER
        around = around[np.argmin(losses(around))] * ratio**_FINEST
        loss = losses(around)
        if loss.min() < context.few.loss:
            first, last = _tread(loss, _LIKELY + _SHARE * MINIMUM_GAIN * context.samples_of_few)
            low, high = around[first], around[last]
            terms.append(_term(float(0.5 * (low + high)), float(0.5 * (high - low) + around[1] - around[0]) / 1.96))
    return terms


def _likely(context: Context, grid: Floats) -> Floats:
    """The steps that would explain most if the shaft answered a change of the current linearly."""
    commands = [segment.recording.current for segment in context.segments]
    gains = np.concatenate(
        [
            context.gains_of_currents([[q * np.rint(i / q) - i for q in part] for i in commands])
            for part in np.split(grid, _STEPS // _AT_ONCE)
        ]
    )
    peaks = np.flatnonzero((gains >= np.roll(gains, 1)) & (gains >= np.roll(gains, -1)))
    return np.asarray(grid[peaks[np.argsort(-gains[peaks])[:_SIMULATED]]])


def _tread(loss: Floats, allowed: float) -> tuple[int, int]:
    """First and last place around the best that lose no more than is allowed."""
    good = loss <= loss.min() + allowed
    first = last = int(np.argmin(loss))
    while first > 0 and good[first - 1]:
        first -= 1
    while last < len(loss) - 1 and good[last + 1]:
        last += 1
    return first, last


def _term(q: float, standard_error: float) -> Term:
    """The effect with a step that is known."""

    def write(vector: Floats, u: Floats) -> None:
        del u
        vector[_Q] = q

    def parameters(u: Floats) -> dict[str, float]:
        del u
        return {"q": q}

    return Term("dac_quantization", (), write, parameters, (), float(_STEPS), form={"q_standard_error": standard_error})
