"""The balance of forces of several recordings as one linear regression: target, base columns, and columns of effects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.force import base_regressors, force_signals
from hapticd.gap.regression import Blocks
from hapticd.gap.regressors import EFFECTS, filtered_columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.gap.data import Recording

    FloatArray = NDArray[np.float64]

_PIECE_S = 0.25


class Balance:
    """Balance of forces of several recordings, one after the other, m rows in all.

    Args:
        recordings: what was measured. model: nominal model.
        refit_base: base parameters are fitted along; else held, and the effects explain the residual.
        bandwidth_hz: of the filter.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        model: Config,
        *,
        refit_base: bool = False,
        bandwidth_hz: float | None = None,
    ) -> None:
        self.model = model
        self.signals = [force_signals(recording, model, bandwidth_hz) for recording in recordings]
        self._cache: dict[tuple[str, float], dict[str, FloatArray]] = {}
        terms = [base_regressors(signals, model) for signals in self.signals]
        base = {name: np.concatenate([term[name] for term in terms]) for name in terms[0]}
        passive = np.stack([base[name] for name in ("inertia", "viscous", "coulomb")], axis=1)
        if refit_base:
            # Effects are torques on the device, so their columns stand on the side of the drive.
            self.target, self.fixed = -base["drive"], -passive
        else:
            self.target, self.fixed = passive.sum(axis=1) - base["drive"], np.zeros((passive.shape[0], 0))
        self.blocks = Blocks.of(self.signals[0].time_s)
        self.pieces = Blocks.of(self.signals[0].time_s, block_s=_PIECE_S).number
        for signals in self.signals[1:]:
            pieces = Blocks.of(signals.time_s, block_s=_PIECE_S).number
            self.pieces = np.concatenate([self.pieces, pieces + self.pieces[-1] + 1])
            self.blocks = self.blocks.then(Blocks.of(signals.time_s))

    def columns(self, slug: str, value: float) -> dict[str, FloatArray]:
        """Filtered columns (m,) of an effect."""
        if (slug, value) not in self._cache:
            parts = [filtered_columns(signals, self.model, slug, value) for signals in self.signals]
            self._cache[slug, value] = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return self._cache[slug, value]

    def grid(self, slug: str) -> FloatArray:
        """Values of the nonlinear parameter to try."""
        return EFFECTS[slug].grid(self.signals[0])

    def position(self) -> FloatArray:
        """Smoothed position (m,) at the rows."""
        return np.concatenate(
            [s.motion.position[s.low_pass.rows(s.motion.position.size)][s.rows] for s in self.signals]
        )
