"""One recorded run of any file format, as arrays in SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hapticd.gap.arrays import Floats


@dataclass(frozen=True)
class Recording:
    """One run, n samples, rotary in rad and N m, linear in m and N.

    Attributes:
        name: file it came from.
        time_s: (n,) instants of the samples, strictly rising from 0.
        position: (n,) centre of the quantisation cell, with the sign that the loop sees.
        resolution: width of a quantisation cell, rad or m; 0 if the positions are not quantised.
        current: (n,) commanded current in A. Row k is applied from ``time_s[k]`` + input delay of the model until
            the same instant of row k + 1 (zero-order hold).
        current_measured: (n,) current reported by the amplifier in A, if every sample has one.
        period_s: median time between samples.
        is_linear: metres and newtons.
        added: (n,) current in A for a known additional torque; it does not pass the amplifier. None for none.
        warnings: limits of the conclusions, in words.
    """

    name: str
    time_s: Floats
    position: Floats
    resolution: float
    current: Floats
    current_measured: Floats | None
    period_s: float
    is_linear: bool
    warnings: tuple[str, ...] = ()
    added: Floats | None = None

    @property
    def rows(self) -> int:
        """Number of samples."""
        return int(self.time_s.size)

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last."""
        return float(self.time_s[-1] - self.time_s[0])
