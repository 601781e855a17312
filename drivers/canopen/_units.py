"""Conversion between ampere and the drive's raw numbers, with the drive's rated values.

A torque object is in ‰ of the rated torque 0x6076 (0.001 N m), a current object in ‰ of the rated current 0x6075 (mA)
(CiA 402-2). A torque object is converted to a current with the config's torque constant, so that the torque of the spring
is right to the last ‰.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from drivers.interface import DriverError

RAW_MAX: Final = 32767


@dataclass(frozen=True)
class Rated:
    """The values of 1000 ‰, from :func:`drivers.canopen._plausible.rated_values`."""

    current: float | None
    """A; None if neither the drive nor the config has it."""
    torque: float | None
    """N m (or N)."""
    torque_constant: float
    """amplifier.torque_constant of the config, N m/A or N/A."""

    def ampere_per_raw(self, unit: str) -> float:
        """A per raw unit of a ``unit`` of :mod:`drivers.canopen.profile`.

        Raises:
            DriverError: the drive does not have the rated value for the unit.
        """
        if unit == "centiampere":
            return 0.01
        if unit == "milliampere":
            return 0.001
        if unit == "permille_rated_torque" and self.torque:
            return 1e-3 * self.torque / self.torque_constant
        if self.current:
            return 1e-3 * self.current
        raise DriverError(f"the profile's unit is {unit}, but the drive has no rated value for it (0x6075, 0x6076)")

    def command_per_ampere(self, unit: str, peak_current: float | None) -> float:
        """Raw target per A.

        Raises:
            DriverError: the peak current does not fit into the 16 bits of the target.
        """
        scale = 1.0 / self.ampere_per_raw(unit)
        if peak_current and peak_current * scale > RAW_MAX:
            raise DriverError(
                f"amplifier.peak_current = {peak_current:g} A is {peak_current * scale:.0f} in the target's unit ({unit}), "
                f"more than its 16 bits allow ({RAW_MAX})"
            )
        return scale
