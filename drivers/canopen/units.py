"""From ampere to the drive's raw numbers and back, by way of the drive's own rated values.

A torque object counts in ‰ of the rated torque 0x6076 (0.001 N m), a current object in ‰ of the rated current 0x6075 (mA)
(CiA 402-2). A torque object is turned into a current with the config's torque constant, so that the torque of the spring
is right to the last ‰; the drive's own torque per ampere, 0x6076 / 0x6075, must agree with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from drivers.interface import DriverError

_KT_TOLERANCE: Final = 0.1
RAW_MAX: Final = 32767


@dataclass(frozen=True)
class Rated:
    """What the drive says of its motor."""

    current_ma: int | None
    """0x6075, mA; None where it does not say."""
    torque_mnm: int | None
    """0x6076, 0.001 N m (or 0.001 N)."""
    torque_constant: float
    """amplifier.torque_constant of the config, N m/A or N/A."""

    def check(self) -> None:
        """Refuse rated values that are zero or that contradict the config.

        Raises:
            DriverError: with both numbers.
        """
        for what, value in (("rated current 0x6075", self.current_ma), ("rated torque 0x6076", self.torque_mnm)):
            if value == 0:
                raise DriverError(f"{what} is 0: the motor is not set up in the drive, so its ‰ mean nothing")
        if self.current_ma and self.torque_mnm:
            own = self.torque_mnm / self.current_ma
            if abs(own - self.torque_constant) > _KT_TOLERANCE * self.torque_constant:
                raise DriverError(
                    f"the drive's motor has {own:.4g} N m/A (rated torque 0x6076 = {self.torque_mnm} mN m at rated current "
                    f"0x6075 = {self.current_ma} mA), amplifier.torque_constant is {self.torque_constant:.4g}: one of the "
                    "two is for another motor"
                )

    def ampere_per_raw(self, unit: str) -> float:
        """A per raw unit of a ``unit`` of :mod:`drivers.canopen.profile`.

        Raises:
            DriverError: the drive lacks the rated value that the unit needs.
        """
        if unit == "centiampere":
            return 0.01
        if unit == "milliampere":
            return 0.001
        if unit == "permille_rated_torque" and self.torque_mnm:
            return 1e-6 * self.torque_mnm / self.torque_constant
        if self.current_ma:
            return 1e-6 * self.current_ma
        raise DriverError(f"the profile counts in {unit}, but the drive has no rated value for it (0x6075, 0x6076)")

    def command_per_ampere(self, unit: str, peak_current: float | None) -> float:
        """Raw target per A.

        Raises:
            DriverError: the peak current does not fit into the 16 bits of the target.
        """
        scale = 1.0 / self.ampere_per_raw(unit)
        if peak_current and peak_current * scale > RAW_MAX:
            raise DriverError(
                f"amplifier.peak_current = {peak_current:g} A is {peak_current * scale:.0f} in the target's unit ({unit}), "
                f"more than its 16 bits hold ({RAW_MAX})"
            )
        return scale
