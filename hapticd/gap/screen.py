"""Which effects could explain the missing torque: a ranking by held-out residual, before anything is simulated.

Every effect is a few columns of the balance of forces (`regressors`), fitted on blocks of the record and judged on the
others; a nonlinear parameter is chosen anew without each fold. This ranks candidates and starts their fits. It does not
name: the balance cannot see what happens inside a filter's width.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.balance import Balance
from hapticd.gap.force_search import grip_interval, ripple_orders
from hapticd.gap.regression import block_gain, cross_validated, estimate, solve
from hapticd.gap.regressors import EFFECTS, IDENTICAL, screened

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.gap.data import Recording

    FloatArray = NDArray[np.float64]

SIGNIFICANT = 3.0
"""Standard errors that a held-out gain must reach."""
_OVERLAP = 0.5
_WORTH = 0.01
"""Less of the squared residual than this decides nothing, however sure it is."""


@dataclass(frozen=True)
class Coefficient:
    """A linear coefficient, with its standard error between blocks (0 for a value taken from a grid)."""

    value: float
    standard_error: float


@dataclass(frozen=True)
class ScreenScore:
    """One effect added to the model.

    Attributes:
        slug: the effect.
        coefficients: by name, SI units; what is not linear is the grid's best value.
        rms: residual of the fit. cv_rms: held out.
        share: part of the squared held-out residual that goes away; negative if it grows.
        z: how sure the blocks are that it does, in standard errors (`regression.block_gain`).
        identical_to: effects that have the same columns.
        possible: whether the coefficients are what the law allows.
        residual: (m,) held-out residual.
    """

    slug: str
    coefficients: dict[str, Coefficient]
    rms: float
    cv_rms: float
    share: float
    z: float
    identical_to: tuple[str, ...]
    possible: bool
    residual: FloatArray = field(repr=False)

    @property
    def significant(self) -> bool:
        """Whether the gain is more than chance between blocks, worth speaking of, and of an effect that can be."""
        return self.possible and self.share > _WORTH and self.z > SIGNIFICANT


@dataclass(frozen=True)
class Confounded:
    """Two effects that explain the same part of the residual.

    Attributes:
        first, second: slugs, the better one first.
        overlap: part of the second's gain that is gone once the first is in.
        advantage: part of the squared held-out residual by which the first is better.
        advantage_z: how sure the blocks are of it, in standard errors.
    """

    first: str
    second: str
    overlap: float
    advantage: float
    advantage_z: float

    @property
    def resolved(self) -> bool:
        """Whether these data decide for the first."""
        return self.advantage > _WORTH and self.advantage_z > SIGNIFICANT


@dataclass(frozen=True)
class Screening:
    """A ranking, best held-out residual first.

    Attributes:
        ranking: one score an effect. rms, cv_rms: of the model with ``given`` and nothing more.
        confounded: pairs among the significant ones.
    """

    ranking: tuple[ScreenScore, ...]
    rms: float
    cv_rms: float
    confounded: tuple[Confounded, ...]


def screen(
    recordings: Sequence[Recording],
    model: Config,
    effects: Iterable[str] | None = None,
    *,
    given: Sequence[str] = (),
    refit_base: bool = False,
    bandwidth_hz: float | None = None,
) -> Screening:
    """Rank effects by how much of the missing torque they explain on blocks they were not fitted to.

    Args:
        recordings: runs of one device. model: nominal model.
        effects: slugs to try; those without columns are passed over. None: all.
        given: slugs that are in the model already; their coefficients are fitted along.
        refit_base: fit the base parameters along.
        bandwidth_hz: of the filter; None: `smooth.default_bandwidth`.

    Raises:
        ValueError: a recording has too little motion.
    """
    balance = Balance(recordings, model, refit_base=refit_base, bandwidth_hz=bandwidth_hz)
    fixed = balance.fixed
    for slug in given:
        fixed = np.column_stack([fixed, *_best(balance, fixed, slug)[1].values()])
    before = cross_validated(fixed, balance.target, balance.blocks)
    linear = recordings[0].is_linear
    wanted = [slug for slug in screened(balance.signals[0], linear=linear, refit_base=refit_base) if slug not in given]
    if effects is not None:
        wanted = [slug for slug in wanted if slug in set(effects)]
    scores = sorted(
        (_score(balance, fixed, slug, before) for slug in wanted), key=lambda score: (not score.possible, score.cv_rms)
    )
    rms = estimate(fixed, balance.target, balance.blocks).rms
    return Screening(tuple(scores), rms, _rms(before), tuple(_confounded(balance, fixed, scores, before)))


def _score(balance: Balance, fixed: FloatArray, slug: str, before: FloatArray) -> ScreenScore:
    values, columns = _best(balance, fixed, slug)
    design = np.column_stack([fixed, *columns.values()])
    fit = estimate(design, balance.target, balance.blocks)
    residual = _held_out(balance, fixed, slug, design)
    share, z = block_gain(before, residual, balance.blocks)
    first = fixed.shape[1]
    coefficients = {name: Coefficient(value, 0.0) for name, value in values.items()}
    for index, name in enumerate(columns):
        coefficients[name] = Coefficient(
            float(fit.coefficients[first + index]), float(fit.standard_errors[first + index])
        )
    bounds = EFFECTS[slug].bounds
    possible = all(low <= coefficients[name].value <= high for name, (low, high) in bounds.items())
    same = tuple(sorted(set().union(*(group for group in IDENTICAL if slug in group)) - {slug}))
    return ScreenScore(slug, coefficients, fit.rms, _rms(residual), share, z, same, possible, residual)


def _best(
    balance: Balance, fixed: FloatArray, slug: str, rows: NDArray[np.bool_] | None = None
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Nonlinear parameters of an effect that explain ``rows`` best, and all its columns there."""
    rows = np.ones(balance.target.size, dtype=np.bool_) if rows is None else rows
    if slug == "torque_ripple":
        chosen = [balance.columns(slug, order) for order in ripple_orders(balance, fixed, rows)]
        return {}, {name: column for columns in chosen for name, column in columns.items()}
    if slug == "hand_impedance":
        return grip_interval(balance, fixed, rows)
    best, least = 0.0, np.inf
    grid = balance.grid(slug)
    for value in grid if grid.size > 1 else ():
        design = np.column_stack([fixed, *balance.columns(slug, value).values()])[rows]
        left = _rms(balance.target[rows] - design @ solve(design, balance.target[rows]))
        best, least = (float(value), left) if left < least else (best, least)
    nonlinear = EFFECTS[slug].nonlinear
    return ({nonlinear: best} if nonlinear else {}), balance.columns(slug, best)


def _held_out(balance: Balance, fixed: FloatArray, slug: str, design: FloatArray) -> FloatArray:
    """Residual of each fold with everything about the effect, orders and grid values too, fitted on the others."""
    if not EFFECTS[slug].nonlinear:
        return cross_validated(design, balance.target, balance.blocks)
    residual = np.empty_like(balance.target)
    for fold in range(balance.blocks.folds):
        held = balance.blocks.fold == fold
        columns = _best(balance, fixed, slug, ~held)[1]
        chosen = np.column_stack([fixed, *columns.values()])
        residual[held] = balance.target[held] - chosen[held] @ solve(chosen[~held], balance.target[~held])
    return residual


def _confounded(
    balance: Balance, fixed: FloatArray, scores: Sequence[ScreenScore], before: FloatArray
) -> Iterable[Confounded]:
    """Pairs of significant effects of which the second has little left to explain once the first is in."""
    strong = [score for score in scores if score.significant][:6]
    for rank, first in enumerate(strong):
        with_first = np.column_stack([fixed, *_best(balance, fixed, first.slug)[1].values()])
        for second in strong[rank + 1 :]:
            both = np.column_stack([with_first, *_best(balance, with_first, second.slug)[1].values()])
            joint, _ = block_gain(before, cross_validated(both, balance.target, balance.blocks), balance.blocks)
            overlap = 1.0 - (joint - first.share) / second.share
            advantage, sure = block_gain(second.residual, first.residual, balance.blocks)
            if overlap > _OVERLAP:
                yield Confounded(first.slug, second.slug, overlap, advantage, sure)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
