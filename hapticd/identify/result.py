"""The result of an identification, as `hapticd identify --json` prints it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.gap.result import Estimate

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

_FEWEST_DIGITS, _MOST_DIGITS = 4, 9
UNCERTAIN = ("inertia", "viscous", "coulomb", "delay_s")
"""The parameters of the operating point, in the order of `Identified.deviations`."""


@dataclass(frozen=True)
class Identified:
    """The identified device.

    Attributes:
        inertia, viscous, coulomb, bias, delay: with 95 % intervals; `delay` from sample to motor current, in s.
        sign: 1, or −1 where the encoder counts against the torque.
        deviations: (4,) standard deviations of `UNCERTAIN`: half width over 1.96, so that a normal has the same interval.
        correlation: (4, 4) correlations of `UNCERTAIN`.
        current_gain: measured over commanded current; None if no current was measured.
        torque_constant: as assumed. torque_constant_implied: by a known inertia; None without one.
        declared_delay_s: delay of config and driver.
        runs: files. assumed: values that are not measured. warnings: what limits or contradicts the result.
    """

    inertia: Estimate
    viscous: Estimate
    coulomb: Estimate
    bias: Estimate
    delay: Estimate
    sign: int
    deviations: NDArray[np.float64]
    correlation: NDArray[np.float64]
    torque_constant: float
    declared_delay_s: float
    is_linear: bool
    runs: tuple[str, ...]
    current_gain: Estimate | None = None
    torque_constant_implied: Estimate | None = None
    assumed: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        values = ", ".join(
            f"{name} {getattr(self, name).value:.4g}" for name in ("inertia", "viscous", "coulomb", "delay")
        )
        return f"Identified({values}; {len(self.warnings)} warnings)"

    @property
    def has_bias(self) -> bool:
        """Whether the interval of the bias excludes 0."""
        low, high = self.bias.ci95
        return low > 0.0 or high < 0.0

    @property
    def further_delay_s(self) -> float:
        """Delay in addition to the declared one; 0 if the interval contains the declared one, or the delay is smaller."""
        return max(self.delay.value - self.declared_delay_s, 0.0) if self.delay.ci95[0] > self.declared_delay_s else 0.0

    @property
    def document(self) -> dict[str, Any]:
        """The JSON keys of ``hapticd identify``."""
        unit = "N/A" if self.is_linear else "N m/A"
        return {
            "plant": {name: _estimate(getattr(self, name)) for name in ("inertia", "viscous", "coulomb", "bias")},
            "delay": {**_estimate(self.delay), "declared": self.declared_delay_s},
            "encoder": {"sign": self.sign, "invert_changes": self.sign < 0},
            "torque_constant": {
                "value": self.torque_constant,
                "unit": unit,
                "implied": self.torque_constant_implied and _estimate(self.torque_constant_implied),
            },
            "current_gain": self.current_gain and _estimate(self.current_gain),
            "uncertainty": {
                "deviations": dict(zip(UNCERTAIN, self.deviations.tolist(), strict=True)),
                "correlation": self.correlation.tolist(),
            },
            "runs": list(self.runs),
            "assumed": list(self.assumed),
            "warnings": list(self.warnings),
            "details": dict(self.details),
        }


def interval_digits(estimate: Estimate) -> int:
    """Significant digits in which the ends of an interval differ."""
    low, high = estimate.ci95
    size = max(abs(low), abs(high))
    if high <= low or size == 0.0:
        return _FEWEST_DIGITS
    return int(np.clip(np.ceil(np.log10(size / (high - low))) + 2, _FEWEST_DIGITS, _MOST_DIGITS))


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "ci95": list(estimate.ci95), "unit": estimate.unit}
