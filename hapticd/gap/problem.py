"""What is fitted: samples, the nominal device, and the bounds of the noise."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import constants

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hapticd.gap.arrays import Floats
    from hapticd.gap.series import Series


_FIRST_LOOK = 4


@dataclass(frozen=True)
class Problem:
    """What is fitted: samples, the nominal device, and the bounds of the noise.

    Attributes:
        series: the samples.
        base: device vector of the nominal model.
        torque: what the device's torques are of the order of, N m or N.
        is_linear: metres and newtons.
        begun: frictions that the model has not, and the little that the base has in their place: corrections are factors.
        longest_memory_s: largest correlation time of the disturbance torque [s].
        runs, columns: rows of each run of the filter until now; of those for slopes, which run together, apart.
        slow_noise: noise of each fit with a slow disturbance until now; the next one may begin at the last.
    """

    series: Series
    base: Floats
    torque: float
    is_linear: bool
    begun: Mapping[str, float] = field(default_factory=dict)
    longest_memory_s: float = field(default_factory=lambda: constants.SHORT_MEMORY_S)
    runs: list[int] = field(default_factory=list)
    columns: list[int] = field(default_factory=list)
    slow_noise: list[Floats] = field(default_factory=list)

    @property
    def noise_bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds of the logarithms of the noise parameters."""
        T, q = self.series.period_s, self.series.resolution
        longest = max(self.longest_memory_s, 5.0 * T)
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

    def with_free_memory(self) -> Problem:
        """The same with a disturbance that may remember as long as the recordings can tell."""
        return replace(self, longest_memory_s=max(self.series.duration_s / constants.MEMORIES, self.longest_memory_s))

    def first_look(self) -> Problem:
        """The same on one block of four, from all over the recordings, in a fourth of the time."""
        return replace(self, series=self.series.thinned(_FIRST_LOOK))
