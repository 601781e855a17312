"""Expected gain of an effect from a start: a score test (Rao 1948) along the change that the start makes to the predictions.

Along that direction the likelihood is approximated by a parabola; its maximum is the expected gain. If the effect is linear
in a parameter, the maximum also gives its value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.missing import missing_power

if TYPE_CHECKING:
    from collections.abc import Iterable

    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.terms import Term


_NOTHING, _FAR = 1e-300, 1e100
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Candidate:
    """An effect with a start.

    Attributes:
        slug: the effect. term: with its start.
        expected_gain: of log-likelihood, nats. penalty: logarithm of the number of discrete choices made for it.
        left: share of the missing power that remains at its start; only for effects with memory.
    """

    slug: str
    term: Term
    expected_gain: float
    penalty: float = 0.0
    left: float = 1.0


class Score:
    """Scores of a model's predictions, with its own coordinates projected out."""

    def __init__(self, present: Fit, share: float = 1.0) -> None:
        self.present = present
        self.score, self.information = present.out["score"], present.out["information"]
        self.weight = 1.0 / share
        self.own = present.own_slopes
        H = (self.own * self.information[:, None]).T @ self.own
        self.inverse = np.linalg.pinv(H) if self.own.size else np.zeros((0, 0))

    @cached_property
    def power(self) -> float:
        """Mean square of the model's missing force."""
        return missing_power(self.present)

    def reduced(self, directions: Iterable[Floats]) -> tuple[Floats, Floats]:
        """Gradient (k,) and information (k, k) of directions of the prediction, shape (n, k), in parts of some rows."""
        g = H = cross = np.zeros(())
        first = 0
        for D in directions:
            rows = slice(first, first + len(D))
            weighted = (D * self.information[rows, None]).T
            g, H, cross = g + self.score[rows] @ D, H + weighted @ D, cross + weighted @ self.own[rows]
            first += len(D)
        # For directions within the model's own the difference is rounding, and may be negative.
        left = H - cross @ self.inverse @ cross.T + _ROUNDING * np.diag(np.diag(H))
        return g - cross @ (self.inverse @ (self.own.T @ self.score)), left

    def along(self, item: Term) -> Candidate:
        """A term with its expected gain; its start is scaled to the maximum along its direction."""
        present = self.present
        fit = present.extended(item)
        out = fit.out
        direction = out["mean"] - present.out["mean"]
        if not np.all(np.abs(direction) < _FAR):
            return Candidate(item.slug, item, 0.0)  # the simulated motion diverges
        g, H = self.reduced([direction[:, None]])
        factor = float(g[0] / max(H[0, 0], _NOTHING))
        amplitude = CATALOGUE[item.slug].amplitude
        if not amplitude:
            step = min(max(factor, 0.0), 1.0)
            expected_gain = step * float(g[0]) - 0.5 * step * step * float(H[0, 0])
            left = 1.0
            if CATALOGUE[item.slug].acts_on == "memory":
                fit.scan_power()  # with the noise of the smaller model the right resonance may score worse than none
                left = missing_power(fit) / max(self.power, _NOTHING)
            expected_gain = max(expected_gain, fit.log_likelihood - present.log_likelihood)
            return Candidate(item.slug, item, self.weight * expected_gain, left=left)
        if factor <= 0.0 and not item.is_signed:
            return Candidate(item.slug, item, 0.0)
        return Candidate(item.slug, item.scaled(amplitude, factor), self.weight * 0.5 * factor * float(g[0]))

    def doubled(self, candidate: Candidate) -> Candidate:
        """The candidate with its amplitude doubled as long as that is likelier.

        Near stiction the parabola is only valid within a few counts, and its maximum is too small.
        """
        amplitude = CATALOGUE[candidate.slug].amplitude
        if not amplitude:
            return candidate
        item, gain = candidate.term, self._gain(candidate.term)
        while (more := self._gain(further := item.scaled(amplitude, 2.0))) > gain:
            item, gain = further, more
        return replace(candidate, term=item, expected_gain=max(candidate.expected_gain, gain))

    def _gain(self, item: Term) -> float:
        return self.present.extended(item).log_likelihood - self.present.log_likelihood
