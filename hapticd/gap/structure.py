"""Is anything left in the held-out residual that noise would not leave? A test after the last round.

Every score of `structure_scores` is a sum over blocks of time. With nothing left, that of a block is as likely s as −s,
however correlated the residual is within the block and however unequal the blocks are: the sample size is the number of
blocks. So the scores are flipped block by block (Rademacher signs: the wild cluster bootstrap of Cameron, Gelbach and
Miller 2008), ten thousand times, with the same flips for every test, and the smallest p value is held against the smallest
under the flips (Westfall and Young 1993): `LEVEL` is the probability that any of the tests cries wolf.

Whether it matters is another question. A dependence counts when it predicts `LEAST_SHARE` of the squared residual on blocks
from which it was not formed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.gap.structure_scores import all_scores

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.search import Data, Judged
    from hapticd.gap.structure_scores import Scores

    Floats = NDArray[np.float64]

LEVEL: Final = 0.005
"""Probability of a false alarm of all tests together."""
LEAST_SHARE: Final = 0.05
"""Part of the squared residual below which a dependence is left alone, however sure: a fortieth of the gap."""
_FLIPS = 9999
_FEWEST_UNITS = 20
"""Short recordings have few blocks: these are halved until there are so many signs to flip."""
_OF_ITSELF = ("successive", "smooth")
_NAMES = {
    "current_rate": "the current's rate",
    "since_reversal": "the time since the last reversal",
    "successive": "the residual of the window before",
    "smooth": "the residual of the sample before",
}


@dataclass(frozen=True)
class Dependence:
    """One test of the residual."""

    coordinate: str
    """As in ``where``; ``successive``: successive windows agree; ``smooth``: samples of a window do."""
    p_value: float
    """Probability that chance shows as much in any of the tests."""
    share: float
    """Part of the squared residual that the dependence predicts on other blocks."""
    detail: str = ""
    """Where it is strongest."""

    @property
    def name(self) -> str:
        """The coordinate in words."""
        return _NAMES.get(self.coordinate, self.coordinate)

    @property
    def matters(self) -> bool:
        """Sure, and not negligible."""
        return self.p_value <= LEVEL and self.share >= LEAST_SHARE

    @property
    def words(self) -> str:
        """The finding in a sentence."""
        return (
            f"What is left depends on {self.name}, which explains {100.0 * max(self.share, 0.0):.0f} % of it"
            f"{self.detail} (p = {self.p_value:.2g} in all tests together)."
        )

    def to_json(self) -> dict[str, Any]:
        """An entry of ``residual_structure.tests`` in gap.json."""
        return {
            "coordinate": self.coordinate,
            "name": self.name,
            "p_value": self.p_value,
            "share": self.share,
            "matters": self.matters,
            "words": self.words,
        }


@dataclass(frozen=True)
class Structure:
    """All tests of the residual, the surest first."""

    tests: tuple[Dependence, ...]
    blocks: int
    """Stretches of time whose signs are flipped: the sample size."""

    @property
    def left(self) -> tuple[Dependence, ...]:
        """What is left and matters: first the coordinates, from which a person can go on, those that explain most first."""
        found = (test for test in self.tests if test.matters)
        return tuple(sorted(found, key=lambda test: (test.coordinate in _OF_ITSELF, -test.share)))

    @property
    def words(self) -> str:
        """The outcome in a sentence or two."""
        surest = self.tests[0]
        if self.left:
            return " ".join(test.words for test in self.left)
        if surest.p_value <= LEVEL:
            return f"{surest.words} Less than {100.0 * LEAST_SHARE:.0f} % is too little to matter."
        return (
            f"What is left looks like noise: of {len(self.tests)} tests over {self.blocks} stretches of time none finds "
            f"structure (smallest p = {surest.p_value:.2g}, corrected for their number)."
        )

    def to_json(self) -> dict[str, Any]:
        """``residual_structure`` of gap.json."""
        return {
            "p_value": self.tests[0].p_value,
            "level": LEVEL,
            "least_share": LEAST_SHARE,
            "blocks": self.blocks,
            "words": self.words,
            "tests": [test.to_json() for test in self.tests],
        }


def residual_structure(data: Data, judged: Judged, seed: int = 0) -> Structure:
    """Test the held-out residual of a model for structure.

    Args:
        data: windows. judged: the model, cross-validated. seed: of flips and replicas.
    """
    rng = np.random.default_rng(seed)
    scores = all_scores(data, judged, rng)
    unit = units(data.block)
    p_values = chance(list(scores.values()), unit, rng)
    tests = [
        Dependence(name, float(p), score.share, score.detail)
        for (name, score), p in zip(scores.items(), p_values, strict=True)
    ]
    return Structure(tuple(sorted(tests, key=lambda test: (test.p_value, -test.share))), int(unit.max()) + 1)


def units(block: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number (w,) of the stretch each window lies in: its block, or a part of it where blocks are few."""
    number = np.unique(block, return_inverse=True)[1]
    parts = 1
    while parts * (number.max() + 1) < _FEWEST_UNITS and parts < np.bincount(number).max():
        parts *= 2
    within = np.arange(number.size) - np.searchsorted(number, number)
    size = np.bincount(number)[number]
    return np.asarray(np.unique(parts * number + parts * within // size, return_inverse=True)[1])


def chance(scores: Sequence[Scores], unit: NDArray[np.int64], rng: np.random.Generator) -> Floats:
    """p value of each test, corrected for their number, from flips of the signs of the units' scores."""
    count = int(unit.max()) + 1
    signs = np.concatenate([np.ones((1, count)), rng.choice([-1.0, 1.0], (_FLIPS, count))])
    ranks = np.empty((len(scores), _FLIPS + 1))
    for row, score in enumerate(scores):
        sums = np.zeros((count, score.values.shape[1]))
        np.add.at(sums, unit, score.values)
        statistic = score.statistic(signs @ sums)
        # Of equal values each has the rank of the last, so that a test that sees nothing has p = 1.
        ranks[row] = statistic.size - np.searchsorted(np.sort(statistic), statistic, side="left")
    smallest = np.sort(ranks.min(axis=0))
    return np.asarray(np.searchsorted(smallest, ranks[:, 0], side="right") / (_FLIPS + 1))
