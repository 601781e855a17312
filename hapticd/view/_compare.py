"""The difference of two runs, on a time axis from the start of rendering in each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.record import RunFileError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.view.signals import Signals

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Difference:
    """The second run minus the first, at times in both.

    Attributes:
        time_s: (m,) of the first run's rows. position: (m,) in its unit. current: (m,) in its unit.
        position_unit, current_unit: their units.
    """

    time_s: FloatArray
    position: FloatArray
    current: FloatArray
    position_unit: str
    current_unit: str

    @property
    def document(self) -> dict[str, Any]:
        """RMS and largest difference, for ``hapticd plot --json``."""
        return {
            "rows": self.time_s.size,
            "duration_s": float(np.ptp(self.time_s)),
            "position": _sizes(self.position, self.position_unit),
            "command": _sizes(self.current, self.current_unit),
        }


def difference(first: Signals, second: Signals) -> Difference:
    """Subtract the first run from the second, which is interpolated linearly.

    Raises:
        RunFileError: they have no time in common, or different units of position or command.
    """
    for name, one, other in (
        ("positions", first.position_unit, second.position_unit),
        ("commands", first.current_unit, second.current_unit),
    ):
        if one != other:
            raise RunFileError(
                f"{second.run.path} has {name} in {other}, {first.run.path} in {one}: no difference between them"
            )
    ours, theirs = first.time_s, second.time_s
    both = (ours >= max(0.0, theirs[0])) & (ours <= theirs[-1])
    if np.count_nonzero(both) < 2:
        raise RunFileError(f"{first.run.path} and {second.run.path} have no time in common")
    time_s = ours[both]
    return Difference(
        time_s,
        np.interp(time_s, theirs, second.position) - first.position[both],
        np.interp(time_s, theirs, second.current) - first.current[both],
        first.position_unit,
        first.current_unit,
    )


def _sizes(values: FloatArray, unit: str) -> dict[str, Any]:
    return {"rms": float(np.sqrt(np.mean(values**2))), "max": float(np.max(np.abs(values))), "unit": unit}
