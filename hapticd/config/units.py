"""Quantities as people write them: ``0.5rad``, ``30deg``, ``2mm``, ``10.3ticks``, ``90 deg/s``, ``500ms``.

A coarse tick means something else after every change of the decimation, an angle does not. A number without a unit keeps the
meaning that its option states. The tables are those of ``hapticd import``, too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from hapticd.config.nearest import nearest_name
from hapticd.config.text import decimal_comma

if TYPE_CHECKING:
    from hapticd.config.model import Config

TIME_UNITS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
ANGLE_UNITS: Final = {
    "rad": 1.0,
    "mrad": 1e-3,
    "deg": math.pi / 180.0,
    "rev": 2.0 * math.pi,
    "arcmin": math.pi / 10_800.0,
    "arcsec": math.pi / 648_000.0,
}
LENGTH_UNITS: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254}
CURRENT_UNITS: Final = {"A": 1.0, "mA": 1e-3, "uA": 1e-6}
TORQUE_UNITS: Final = {"N m": 1.0, "mN m": 1e-3, "uN m": 1e-6, "N cm": 1e-2}
FORCE_UNITS: Final = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
_OF_THE_ENCODER: Final = ("ticks", "counts")
_SPELLINGS: Final = {
    "tick": "ticks",
    "count": "counts",
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "µm": "um",
    "μm": "um",
    "µs": "us",
    "μs": "us",
    "turn": "rev",
    "turns": "rev",
    "sec": "s",
    "periods": "period",
}
_WRITTEN: Final = re.compile(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


class UnitError(ValueError):
    """A quantity that cannot be read, or is of the wrong kind; the text says what would be right."""


def split(text: str) -> tuple[float, str]:
    """The finite number of a quantity and its unit, ``""`` without one.

    Raises:
        UnitError: there is no number, or none that is finite.
    """
    found = _WRITTEN.fullmatch(text)
    number, unit = (found[1], found[2]) if found else (text, "")
    try:
        value = float(number)
    except ValueError:
        with_point = decimal_comma(number)
        hint = f"; the decimal sign is a point: {with_point}{unit}" if with_point else ""
        raise UnitError(f"{text!r} is not a number{hint}") from None
    if not math.isfinite(value):
        raise UnitError(f"{text!r} is not a finite number")
    return value, "/".join(_SPELLINGS.get(part.strip(), part.strip()) for part in unit.split("/")) if unit else ""


def deflection_ticks(asked: float | str, config: Config) -> float:
    """A deflection in coarse ticks; a bare number is one in ticks already.

    Raises:
        UnitError: no number, an unknown unit, or an angle of a linear device (a length of a rotary one).
    """
    if not isinstance(asked, str):
        return asked
    value, unit = split(asked)
    if unit in ("", "ticks"):
        return value
    return value * _of_place(unit, asked, config) / config.resolution


def velocity_ticks(asked: float | str, config: Config) -> float:
    """A velocity in coarse ticks per servo period; a bare number is one already.

    Raises:
        UnitError: as in :func:`deflection_ticks`; or the unit is not a place per time.
    """
    if not isinstance(asked, str):
        return asked
    value, unit = split(asked)
    place, slash, time = ("rev", "/", "min") if unit == "rpm" else (unit or "ticks/period").partition("/")
    times = {**TIME_UNITS, "period": config.period}
    if not slash or time not in times:
        per = ", ".join(times)
        raise UnitError(f"{asked!r} is no velocity: write a place per time, such as 2 rad/s; times are {per}; or rpm")
    return value * _of_place(place, asked, config) / config.resolution * config.period / times[time]


def seconds(asked: float | str) -> float:
    """A duration in s, which is what a bare number is.

    Raises:
        UnitError: no number, or an unknown unit.
    """
    if not isinstance(asked, str):
        return asked
    value, unit = split(asked)
    return value * _factor(unit or "s", asked, {**TIME_UNITS, "h": 3600.0})


def amplitude(asked: float | str, config: Config, *, moves_origin: bool) -> float:
    """Peak of an excitation in A, or in rad or m where it moves the spring's origin; a bare number is one already.

    Raises:
        UnitError: as in :func:`deflection_ticks`; or a current where a place is wanted, and the other way round.
    """
    if not isinstance(asked, str):
        return asked
    value, unit = split(asked)
    if not unit:
        return value
    return value * (_of_place(unit, asked, config) if moves_origin else _factor(unit, asked, CURRENT_UNITS))


def _of_place(unit: str, asked: str, config: Config) -> float:
    """A unit of place in rad or m."""
    own, other = (LENGTH_UNITS, ANGLE_UNITS) if config.is_linear else (ANGLE_UNITS, LENGTH_UNITS)
    if unit in other:
        kind, wanted = ("linear", "length") if config.is_linear else ("rotary", "angle")
        raise UnitError(f"{asked!r}: the device is {kind}; give {wanted}s in {', '.join([*own, *_OF_THE_ENCODER])}")
    encoder = dict(zip(_OF_THE_ENCODER, (config.resolution, config.raw_resolution), strict=True))
    return _factor(unit, asked, {**own, **encoder})


def _factor(unit: str, asked: str, units: Mapping[str, float]) -> float:
    if unit not in units:
        near = nearest_name(unit, units)
        hint = f"did you mean {near}? " if near else ""
        raise UnitError(f"{asked!r}: unknown unit {unit!r}; {hint}units here: {', '.join(units)}")
    return units[unit]
