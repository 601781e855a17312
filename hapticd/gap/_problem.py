"""The fitting problem: samples, the nominal device, and the bounds of the noise."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import constants

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hapticd.gap.arrays import Floats
    from hapticd.gap.series import Series


_BLOCKS_PER_SUBSAMPLE = 4


@dataclass(frozen=True)
class Problem:
    """The fitting problem: samples, the nominal device, and the bounds of the noise.

    Attributes:
        series: the samples.
        base: device vector of the nominal model.
        torque: order of magnitude of the device's torques, N m or N.
        is_linear: metres and newtons.
        assumed_friction: key of a friction that is 0 in the model to the small value that is assumed instead, because
            corrections are factors.
        longest_correlation_s: largest correlation time of the disturbance torque [s].
        runs, columns: number of rows of each filter run so far; `columns`: of the runs for derivatives.
        slow_noise: noise of each fit with a slow disturbance so far; the next fit may start from the last.
    """

    series: Series
    base: Floats
    torque: float
    is_linear: bool
    assumed_friction: Mapping[str, float] = field(default_factory=dict)
    longest_correlation_s: float = field(default_factory=lambda: constants.SHORT_CORRELATION_S)
    runs: list[int] = field(default_factory=list)
    columns: list[int] = field(default_factory=list)
    slow_noise: list[Floats] = field(default_factory=list)

    @property
    def noise_bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds of the logarithms of the noise parameters."""
        T, q = self.series.period_s, self.series.resolution
        longest = max(self.longest_correlation_s, 5.0 * T)
        root = np.sqrt(T)
        lower = [
            constants.LEAST_WHITE * self.torque * root,
            0.01 * q,
            1e-6 * self.torque,
            min(3.0 * T, 0.5 * longest),
            1e-4 * T,
        ]
        upper = [1e3 * self.torque * root, 1e5 * q, 1e2 * self.torque, longest, 3.0 * T]
        return np.log(lower), np.log(upper)

    def with_slow_disturbance(self) -> Problem:
        """The same with the larger bound of the disturbance's correlation time."""
        return replace(
            self,
            longest_correlation_s=max(self.series.duration_s / constants.CORRELATION_TIMES, self.longest_correlation_s),
        )

    def subsample(self) -> Problem:
        """The same on a subsample: one block of four, from all parts of the recordings."""
        return replace(self, series=self.series.subsample(_BLOCKS_PER_SUBSAMPLE))
