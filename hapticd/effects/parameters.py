"""Kinds of parameters that several effects have, and grids of values to start a fit from.

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
    """A share of something, which a config must give."""
    return Parameter(name, *NUMBER, neutral=0.0, lower=lower, upper=upper, required=True)


def shift(name: str, units: tuple[str, str] = ANGLE, limit: float = 1e6) -> Parameter:
    """A place, anywhere."""
    return Parameter(name, *units, neutral=0.0, lower=-limit, upper=limit)


def phase(name: str = "phi", length: int = 1) -> Parameter:
    """An angle within two turns both ways."""
    return Parameter(name, "rad", "rad", neutral=0.0, lower=-4 * math.pi, upper=4 * math.pi, length=length)


def magnitude(name: str, units: tuple[str, str], upper: float, *, required: bool = True) -> Parameter:
    """Something ≥ 0 that is absent at 0."""
    return Parameter(name, *units, neutral=0.0, lower=0.0, upper=upper, scale="log", required=required)


def load_share() -> Parameter:
    """Share of the inertia that is behind the motor."""
    return Parameter("load_share", *NUMBER, neutral=0.5, lower=0.01, upper=0.99)


def corrected(nominal: float, r: float) -> float:
    """Return the value that a device has of a base parameter that is wrong by a share r."""
    return nominal * (1.0 + r)


def log_grid(low: float, high: float, count: int) -> tuple[float, ...]:
    """Values from `low` to `high` that rise by a common factor; none unless 0 < low < high."""
    if not 0.0 < low < high:
        return ()
    return tuple(low * (high / low) ** (k / (count - 1)) for k in range(count))


def small_ways(scale: Scale, factor: float) -> tuple[float, ...]:
    """Displacements that motion may hide, rising by about a factor: from a few counts to a tenth of the travel."""
    low, high = max(4.0 * scale.resolution, 1e-5 * scale.travel), 0.1 * scale.travel
    return log_grid(low, high, 2 + int(math.log(high / low) / math.log(factor))) if high > low > 0.0 else ()


def phases(count: int) -> tuple[float, ...]:
    """Angles all round the circle [rad]."""
    return tuple(2.0 * math.pi * k / count for k in range(count))
