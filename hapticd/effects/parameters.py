"""Kinds of parameters of several effects, and grids of start values for a fit.

Angles, torques and inertias of a rotary device become lengths, forces and masses of a linear one: units come in pairs.
"""

from __future__ import annotations

import math

from hapticd.effects.spec import Parameter, Scale

NUMBER = ("", "")
TORQUE = ("N m", "N")
ANGLE = ("rad", "m")
SPEED = ("rad/s", "m/s")
DAMPING = ("N m s/rad", "N s/m")
STIFFNESS = ("N m/rad", "N/m")
INERTIA = ("kg m²", "kg")


def relative(name: str, lower: float, upper: float) -> Parameter:
    """A relative change; required in a config."""
    return Parameter(name, *NUMBER, neutral=0.0, lower=lower, upper=upper, required=True)


def shift(name: str, units: tuple[str, str] = ANGLE, limit: float = 1e6) -> Parameter:
    """A position, of either sign."""
    return Parameter(name, *units, neutral=0.0, lower=-limit, upper=limit)


def phase(name: str = "phi", length: int = 1) -> Parameter:
    """An angle within ± two turns."""
    return Parameter(name, "rad", "rad", neutral=0.0, lower=-4 * math.pi, upper=4 * math.pi, length=length)


def magnitude(name: str, units: tuple[str, str], upper: float, *, required: bool = True) -> Parameter:
    """A number ≥ 0 whose effect is off at 0."""
    return Parameter(name, *units, neutral=0.0, lower=0.0, upper=upper, scale="log", required=required)


def load_share() -> Parameter:
    """Share of the inertia that belongs to the load."""
    return Parameter("load_share", *NUMBER, neutral=0.5, lower=0.01, upper=0.99)


def corrected(nominal: float, r: float) -> float:
    """Return the true value of a base parameter with the relative error r."""
    return nominal * (1.0 + r)


def log_grid(low: float, high: float, count: int) -> tuple[float, ...]:
    """`count` values from `low` to `high` with a common ratio; none unless 0 < low < high."""
    if not 0.0 < low < high:
        return ()
    return tuple(low * (high / low) ** (k / (count - 1)) for k in range(count))


def small_displacements(scale: Scale, factor: float) -> tuple[float, ...]:
    """Displacements from a few counts to a tenth of the travel, with about a common ratio."""
    low, high = max(4.0 * scale.resolution, 1e-5 * scale.travel), 0.1 * scale.travel
    return log_grid(low, high, 2 + int(math.log(high / low) / math.log(factor))) if high > low > 0.0 else ()


def phases(count: int) -> tuple[float, ...]:
    """Angles evenly around the circle [rad]."""
    return tuple(2.0 * math.pi * k / count for k in range(count))
