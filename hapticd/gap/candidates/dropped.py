"""Commands that never arrived.

Which ticks were lost is not recorded. Each window's residual votes for or against every loss (`fates`); the likeliest set
is simulated, and what it leaves votes again. What the choice costs against all other sets stays in the window's loss, so
that the freedom to choose buys no evidence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.candidates.fates import Shaft, effective, find
from hapticd.gap.fit import fit
from hapticd.gap.hypothesis import Term
from hapticd.plant.layout import word

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.candidates.fates import Fates
    from hapticd.gap.context import Context
    from hapticd.gap.fit import Fit
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]

_TURNS = 12
_FIRST_GUESS = 0.02
"""Probability of a loss."""
_STEPS, _CLOSE = 8, 0.01
"""Newton steps of the probability in a turn, and the relative change that ends them."""
_LEAST = 1.0
"""Loss that a turn must save for another to be taken."""
_CHUNK = 128
_AT_REST = 1e-3
"""Resolutions that a shaft predicted to stick moves in a tick at the most."""


def _excess(residuals: Floats) -> float:
    """Typical residual in standard deviations, at least one.

    Where something else is missing as well, a residual speaks for or against a loss only by what it has beyond that: else
    the freedom to choose each tick's fate would explain any noise.
    """
    return max(1.0, float(np.sqrt(np.median(np.mean(residuals**2, axis=1)))))


class _Search:
    """Fates assumed in some windows, and the probability of a loss that follows from them."""

    def __init__(
        self, context: Context, segments: Sequence[Segment], states: Sequence[Floats], probability: float
    ) -> None:
        self.context, self.segments, self.states = context, segments, states
        self.commands = [segment.recording.current for segment in segments]
        self.lost = [np.zeros(len(command), dtype=np.bool_) for command in self.commands]
        self.prices = [np.zeros(len(command)) for command in self.commands]
        self.probability, self.spread = probability, 0.0

    def turn(self, residuals: Sequence[Floats]) -> None:
        """Find the fates from what the prediction with those assumed so far leaves, and the probability from them.

        The probability takes Newton steps to its largest likelihood; information is that of the fates less what the data
        leave open of them (Louis 1982).
        """
        for _ in range(_STEPS):
            before = self.probability
            found = [self._all_found(number, residual) for number, residual in enumerate(residuals)]
            self._likeliest([part for of_one in found for part in of_one])
            if abs(self.probability - before) < _CLOSE * before:
                break
        for number, of_one in enumerate(found):
            rows = self.segments[number].windows.rows - 1
            if len(rows):
                self.lost[number][rows] = np.concatenate([part.lost for part in of_one])
                price = np.concatenate([part.price for part in of_one])
                wide = _excess(residuals[number])
                self.prices[number][rows] = price[:, None] / self.segments[number].length * wide**2

    def _all_found(self, number: int, residual: Floats) -> list[Fates]:
        """Fates of all windows of a recording, in chunks."""
        wide = _excess(residual)
        chunks = [slice(first, first + _CHUNK) for first in range(0, self.segments[number].count, _CHUNK)]
        return [self._found(residual / wide, wide, number, chunk) for chunk in chunks]

    def _likeliest(self, found: Sequence[Fates]) -> None:
        """One Newton step of the probability, and its standard error."""
        p = self.probability
        ticks, losses = float(sum(part.lost.size for part in found)), float(sum(part.number.sum() for part in found))
        open_ = float(sum(part.spread.sum() for part in found))
        score = np.concatenate([(part.number - part.lost.shape[1] * p) / (p * (1.0 - p)) for part in found])
        whole = losses / p**2 + (ticks - losses) / (1.0 - p) ** 2
        information = max(whole - open_ / (p * (1.0 - p)) ** 2, 1e-2 * whole)
        self.probability = float(np.clip(p + score.sum() / information, 0.3 * p, min(3.0 * p, 0.5 + 0.5 * p)))
        self.spread = float(np.sqrt(max(1.0 / information, float(score @ score) / information**2)))

    def _found(self, residuals: Floats, wide: float, number: int, part: slice) -> Fates:
        context, segment, command = self.context, self.segments[number], self.commands[number]
        rows, sigma = segment.windows.rows[part] - 1, wide * segment.sigma[part][:, None]
        residual = residuals[part]
        predicted = segment.observed[part] - residual * sigma
        moving = np.abs(np.gradient(predicted, axis=1)) > _AT_REST * segment.resolution
        period = segment.recording.period_s
        assumed = effective(command, self.lost[number])
        shaft = Shaft(
            float(np.exp(-context.viscous / context.inertia * period)),
            context.torque_constant / context.inertia * period**2 / sigma * moving,
        )
        before = assumed[np.maximum(rows[:, 0] - 1, 0)]
        return find(residual, shaft, command[rows], assumed[rows], before, self.probability)

    def fitted(self) -> Fit:
        """The present model with the fates assumed, initial states fitted."""
        solution = self.context.fit.solution
        hypothesis = solution.hypothesis.with_term(self.term())
        return fit(self.segments, hypothesis, solution.u, self.states, 0)

    def settle(self, residuals: Sequence[Floats]) -> tuple[Term | None, float]:
        """Take turns until the loss falls no more; return the best set of fates and its loss."""
        best, least = None, np.inf
        for _ in range(_TURNS):
            self.turn(residuals)
            if not any(mask.any() for mask in self.lost):
                break
            fitted = self.fitted()
            if fitted.solution.total > least - _LEAST:
                break
            best, least, residuals = self.term(), fitted.solution.total, fitted.residuals
        return best, least

    def term(self) -> Term:
        """The effect with the fates assumed."""
        index, probability = word("dropped_samples.p"), self.probability

        def write(vector: Floats, u: Floats) -> None:
            vector[index] = probability

        def parameters(u: Floats) -> dict[str, float]:
            return {"p": probability}

        return Term(
            "dropped_samples",
            (),
            write,
            parameters,
            (),
            lost=tuple(mask.astype(np.uint8) for mask in self.lost),
            prices=tuple(price.copy() for price in self.prices),
            form={"p_standard_error": self.spread},
        )


def dropped_samples(context: Context) -> list[Term]:
    """Lost commands, found window by window, and the probability p that follows from them.

    A third of the windows tells whether there are any, and how many about.
    """
    few = context.few
    first = _Search(context, few.segments, few.states, _FIRST_GUESS)
    found, loss = first.settle(few.residuals)
    if found is None or loss >= few.loss:
        return []
    solution = context.fit.solution
    best, _ = _Search(context, context.segments, solution.states, first.probability).settle(context.fit.residuals)
    return [best] if best else []
