"""Implausible values for a 1-DOF haptic device: a wrong unit, a wrong prefix, a shifted decimal point.

The ranges are wide: from a watch-sized motor to the wheel of a driving simulator or an exoskeleton's joint, and from a
linear desktop device to a motion platform. Ratios compare the device with its own motor, and find other errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import pi
from typing import TYPE_CHECKING, NamedTuple

from hapticd.config.assumed import assumed

if TYPE_CHECKING:
    from hapticd.config import Config


class Range(NamedTuple):
    """Usual range of a config key."""

    key: str
    low: float
    high: float
    unit: str
    factors: tuple[tuple[float, str], ...] = ()
    """Units that may have been meant: factor to the key's unit, and name."""


_INERTIAS = ((1e-7, "g cm²"), (1e-4, "kg cm²"), (1e-9, "g mm²"), (1e-3, "g m²"))
_TORQUES = ((1e-3, "mN m"), (1e-2, "N cm"))

ROTARY = (
    Range("plant.inertia", 1e-9, 0.5, "kg m²", _INERTIAS),
    Range("plant.viscous", 0.0, 1.0, "N m s/rad", ((1e-3, "mN m s/rad"), (9.549e-3, "mN m/rpm"))),
    Range("plant.coulomb", 0.0, 10.0, "N m", _TORQUES),
    Range("amplifier.torque_constant", 1e-4, 20.0, "N m/A", _TORQUES),
    Range("encoder.counts_per_rev", 100.0, 1e8, "counts/rev"),
)
LINEAR = (
    Range("plant.inertia", 1e-4, 200.0, "kg", ((1e-3, "g"),)),
    Range("plant.viscous", 0.0, 1e3, "N s/m", ((1e-3, "mN s/m"),)),
    Range("plant.coulomb", 0.0, 500.0, "N", ((1e-3, "mN"),)),
    Range("amplifier.torque_constant", 1e-2, 1e3, "N/A"),
    Range("encoder.counts_per_metre", 1e3, 1e9, "counts/m", ((1e3, "counts/mm"),)),
)
SHORTEST_TIME_CONSTANT_S, LONGEST_TIME_CONSTANT_S = 1e-3, 1e3
FEWEST_STEPS = 50.0
"""Least number of DAC steps up to break-away."""


def implausible(config: Config) -> list[str]:
    """Implausible values, one sentence each, with the value and the unit that was probably meant."""
    return [*_values(config), *_ratios(config)]


def _values(config: Config) -> Iterator[str]:
    for entry in LINEAR if config.is_linear else ROTARY:
        section, _, name = entry.key.partition(".")
        value = getattr(getattr(config, section), name)
        if value is None or entry.low <= value <= entry.high:
            continue
        meant = [
            f"{value:g} {unit} is {value * factor:.3g} {entry.unit}"
            for factor, unit in entry.factors
            if entry.low <= value * factor <= entry.high
        ]
        hint = f"; was another unit meant? {', '.join(meant)}" if meant else ""
        yield (
            f"{entry.key} = {value:g} {entry.unit} is outside the range of 1-DOF devices "
            f"({entry.low:g} to {entry.high:g} {entry.unit}){hint}"
        )


def _ratios(config: Config) -> Iterator[str]:
    plant, amplifier = config.plant, config.amplifier
    unit = "N" if config.is_linear else "N m"
    if plant.viscous > 0.0 and "plant.viscous" not in assumed(config):
        constant = plant.inertia / plant.viscous
        if not SHORTEST_TIME_CONSTANT_S <= constant <= LONGEST_TIME_CONSTANT_S:
            yield (
                f"plant.inertia / plant.viscous = {constant:.3g} s: coasting to rest takes "
                f"{SHORTEST_TIME_CONSTANT_S:g} to {LONGEST_TIME_CONSTANT_S:g} s with 1-DOF devices; one of the two is wrong"
            )
    limit = amplifier.peak_current or amplifier.continuous_current
    if not limit:
        return
    torque = amplifier.torque_constant * limit
    if plant.coulomb >= torque:
        yield (
            f"plant.coulomb = {plant.coulomb:g} {unit} is more than the motor's largest torque {torque:.3g} {unit}: it "
            "could never move"
        )
    acceleration = torque / plant.inertia
    low, high, name = (0.1, 1e4, "m/s²") if config.is_linear else (1.0, 1e7, "rad/s²")
    if not low <= acceleration <= high:
        yield (
            f"the largest torque {torque:.3g} {unit} would accelerate plant.inertia = {plant.inertia:g} at "
            f"{acceleration:.3g} {name}; 1-DOF devices reach {low:g} to {high:g} {name}"
        )
    step = 2.0 * amplifier.dac_full_scale / 2**amplifier.dac_bits if amplifier.dac_bits else 0.0
    if step and amplifier.dac_full_scale and step > amplifier.dac_full_scale / FEWEST_STEPS:
        yield f"amplifier.dac_bits = {amplifier.dac_bits}: one step of the current is {step:.3g} A"
    if not config.is_linear and config.resolution > pi / FEWEST_STEPS:
        yield f"a coarse tick is {config.resolution:.3g} rad; a hand feels every one of them"
