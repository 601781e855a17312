"""Plausibility of a drive's data: rated values, limits, encoder and step, compared with each other and with the config.

A drive with another unit than in its profile, or configured for another motor, multiplies every command by a factor. Nothing
on the bus would show it: the demand is read back in the same wrong unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from drivers.canopen._units import Rated
from drivers.canopen.profile import load_profile
from drivers.interface import DriverError

if TYPE_CHECKING:
    from drivers.canopen.options import Options
    from hapticd.config import Config

LEAST: Final = 0.5
MOST: Final = 5.0
"""Range of the rated current over ``amplifier.continuous_current``: less is an overload, more is a drive that is far too
large, or a wrong unit."""
AGREE: Final = 0.1
"""Largest relative difference of two values of the same quantity."""
LIMIT_RAISED: Final = 5.0
"""Largest factor by which the config may raise a limit stored in the drive."""
FEWEST_STEPS: Final = 30.0
"""Fewest steps of the command up to the peak current."""
_ENCODER_AGREE: Final = 1e-3
_NEAR: Final = 1.6

_CURRENT: Final = (("A", 1.0), ("0.1 A", 0.1), ("0.01 A", 0.01), ("mA", 1e-3), ("0.1 mA", 1e-4), ("µA", 1e-6))
_TORQUE: Final = (
    ("N m", 1.0),
    ("cN m", 1e-2),
    ("oz in", 7.0616e-3),
    ("mN m", 1e-3),
    ("0.1 mN m", 1e-4),
    ("g cm", 9.80665e-5),
    ("µN m", 1e-6),
)
_FORCE: Final = (("N", 1.0), ("0.1 N", 0.1), ("cN", 1e-2), ("mN", 1e-3), ("0.1 mN", 1e-4), ("µN", 1e-6))


@dataclass(frozen=True)
class _Rating:
    """One rated value: the object's number, its possible units (SI first), and the value in the config."""

    what: str
    raw: int
    units: tuple[tuple[str, float], ...]
    unit: str
    """The one of the profile and of CiA 402."""
    key: str
    stated: float | None
    per_ampere: float
    """SI units per A."""

    @property
    def value(self) -> float:
        """In SI units: from the config, else from the drive."""
        return self.raw * dict(self.units)[self.unit] if self.stated is None else self.stated

    @property
    def current(self) -> float:
        """A."""
        return self.value / self.per_ampere

    def __str__(self) -> str:
        if self.stated is not None:
            return f"driver.{self.key} = {self.stated:g} {self.units[0][0]}"
        return f"{self.what} = {self.raw} {self.unit}"

    def likely(self, current: float) -> str | None:
        """A sentence on the unit in which the number is near a current in A; None if there is none."""
        wanted = current * self.per_ampere
        name, scale = min(self.units, key=lambda unit: abs(math.log(self.raw * unit[1] / wanted)))
        if self.stated is not None or name == self.unit or not 1.0 / _NEAR < self.raw * scale / wanted < _NEAR:
            return None
        current = self.raw * scale / self.per_ampere
        return f"{self.raw} {name} would be {current:.3g} A, so the drive's unit is most likely {name}"

    def check_stated(self) -> None:
        """Check that the config's value is the drive's number in some unit."""
        if self.raw == 0:
            raise DriverError(f"{self.what} is 0: the motor is not configured in the drive, so its ‰ have no meaning")
        if self.stated is None or any(abs(self.raw * scale / self.stated - 1.0) <= AGREE for _, scale in self.units):
            return
        raise DriverError(
            f"{self}, but {self.what} = {self.raw} is not so in any of {', '.join(name for name, _ in self.units)}: one of "
            "the two is for another motor"
        )

    def check_usual(self, usual: float, key: str) -> None:
        """Compare a value of the drive only with the current of a key of the amplifier, A; 0: none."""
        if self.stated is not None or usual == 0.0 or LEAST <= self.current / usual <= MOST:
            return
        guess = self.likely(usual) or f"In no usual unit would it be near {usual:g} A"
        raise DriverError(
            f"{self} is a rated current of {self.current:.3g} A, {self.current / usual:.3g} times "
            f"{key} = {usual:g} A; {LEAST:g} to {MOST:g} times are allowed, because a drive that means {usual:g} A makes "
            f"{usual / self.current:.3g} times every commanded current. {guess}. Correct the object or the "
            f"config, or give the value of the motor's data sheet as driver.{self.key} (in {self.units[0][0]})"
        )


def rated_values(current: int | None, torque: int | None, options: Options, config: Config) -> Rated:
    """The drive's rated values, checked against each other and against the config.

    Args:
        current, torque: objects 0x6075 (mA) and 0x6076 (0.001 N m or N) as read; None if the drive has none.
        options: of the driver; its rated values have priority over the drive's. config: amplifier and kind of axis.

    Raises:
        DriverError: with the object, its value, its meaning, the config's key, and the unit that would fit.
    """
    constant = config.amplifier.torque_constant
    key, usual = _usual(config)
    units, unit = (_FORCE, "mN") if config.is_linear else (_TORQUE, "mN m")
    stated_current, stated_torque = options.rated_current, options.rated_torque
    ratings: dict[str, _Rating] = {}
    if current is not None:
        ratings["current"] = _Rating(
            "rated current 0x6075", current, _CURRENT, "mA", "rated_current", stated_current, 1.0
        )
    if torque is not None:
        ratings["torque"] = _Rating("rated torque 0x6076", torque, units, unit, "rated_torque", stated_torque, constant)
    for rating in ratings.values():
        rating.check_stated()
    if len(ratings) == 2:
        _check_quotient(ratings["current"], ratings["torque"], constant)
    for rating in ratings.values():
        rating.check_usual(usual, key)
    return Rated(
        ratings["current"].value if "current" in ratings else stated_current,
        ratings["torque"].value if "torque" in ratings else stated_torque,
        constant,
    )


def _check_quotient(current: _Rating, torque: _Rating, constant: float) -> None:
    own = torque.value / current.value
    if abs(own - constant) <= AGREE * constant:
        return
    guesses = [guess for guess in (torque.likely(current.current), current.likely(torque.current)) if guess]
    raise DriverError(
        f"the drive's motor has {own:.4g} {torque.units[0][0]}/A ({torque} at {current}), amplifier.torque_constant is "
        f"{constant:.4g}: {'; or '.join(guesses) or 'one of the two is for another motor'}"
    )


@cache
def _units(profile: str, changed_ns: int) -> frozenset[str]:
    return frozenset(mode.target.unit for mode in load_profile(profile)[0].modes)


def declared_step(options: Options, config: Config) -> float:
    """The largest step of the command that bring-up accepts, A; exact if the config has the rated values.

    Raises:
        DriverConfigError: there is no such profile.
    """
    usual = MOST * _usual(config)[1]
    torque = usual if options.rated_torque is None else options.rated_torque / config.amplifier.torque_constant
    current = usual if options.rated_current is None else options.rated_current
    rated = Rated(current, torque * config.amplifier.torque_constant, config.amplifier.torque_constant)
    path = Path(options.profile)
    units = _units(options.profile, path.stat().st_mtime_ns if path.is_file() else 0)
    return max(rated.ampere_per_raw(unit) for unit in units) if rated.current and rated.torque else 0.0


def _usual(config: Config) -> tuple[str, float]:
    """The current that a rated current is compared with: the config's key in words, and A; 0 without any limit."""
    amplifier = config.amplifier
    if amplifier.continuous_current:
        return "amplifier.continuous_current", amplifier.continuous_current
    return "a third of amplifier.peak_current", (amplifier.peak_current or 0.0) / 3.0


def check_limit(what: str, index: int, raw: int, found: float, key: str, asked: float) -> None:
    """Refuse to raise a limit stored in the drive by more than `LIMIT_RAISED`: it was set for this motor.

    Raises:
        DriverError: with both currents in A.
    """
    if found > 0.0 and asked > LIMIT_RAISED * found:
        raise DriverError(
            f"amplifier.{key} = {asked:g} A is {asked / found:.3g} times the limit stored in the drive: {what} "
            f"(0x{index:04x}) = {raw}, {found:g} A. At most {LIMIT_RAISED:g} times are allowed: is the config in mA? "
            "Else set the drive's limit for this motor first"
        )


def check_max_torque(index: int, raw: int, limit: float, peak: float | None) -> None:
    """Refuse a drive that clips the command below the config's peak current.

    Raises:
        DriverError: with both currents in A.
    """
    if peak and limit < (1.0 - AGREE) * peak:
        raise DriverError(
            f"max torque 0x{index:04x} = {raw} ‰ clips the command at {limit:.3g} A, and amplifier.peak_current is {peak:g} "
            "A: theory and trips would assume a current that is never reached; raise the first or lower the second"
        )


def check_encoder(index: int, increments: int, turns: int, counts_per_rev: float) -> None:
    """Refuse an encoder resolution of the drive that is not the config's.

    Raises:
        DriverError: with both, and the usual reason.
    """
    if increments == 0 or turns == 0:
        return
    own = increments / turns
    ratio = own / counts_per_rev
    if abs(ratio - 1.0) <= _ENCODER_AGREE:
        return
    lines = any(abs(ratio / usual - 1.0) < _ENCODER_AGREE for usual in (4.0, 0.25))
    why = "one of the two counts lines, with 4 edges each" if lines else "one of the two is for another encoder"
    raise DriverError(
        f"position encoder resolution 0x{index:04x} is {increments} counts in {turns} revolutions, {own:g} counts/rev; "
        f"encoder.counts_per_rev is {counts_per_rev:g}: {why}"
    )


def check_step(target: str, step: float, peak: float | None) -> None:
    """Refuse a step of the command with too few steps up to the peak current.

    Raises:
        DriverError: with both currents in A.
    """
    if peak and step * FEWEST_STEPS > peak:
        raise DriverError(
            f"one step of the command ({target}) is {step:.3g} A, and amplifier.peak_current = {peak:g} A is "
            f"{peak / step:.3g} of them where {FEWEST_STEPS:g} are needed: the drive is too large for this motor, or its "
            "rated values are in another unit"
        )
