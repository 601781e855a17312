"""Quantities with units: ``0.5rad``, ``30deg``, ``2mm``, ``10.3ticks``, ``3Nm/rad``, ``60 g cm²``, ``500ms``.

One parser for config files, ``set``, options, ``init`` and import maps. The size of a coarse tick depends on the decimation,
that of an angle does not. A number without a unit has the unit of its key or option.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from functools import cache
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
UNITS: Final = frozenset(
    {*TIME_UNITS, *ANGLE_UNITS, *LENGTH_UNITS, *CURRENT_UNITS, *TORQUE_UNITS, *FORCE_UNITS, *_OF_THE_ENCODER}
)

_NEWTON: Final = (1.0, {"kg": 1, "m": 1, "s": -2})
_ATOMS: Final[Mapping[str, tuple[float, Mapping[str, int]]]] = {
    "s": (1.0, {"s": 1}),
    "min": (60.0, {"s": 1}),
    "h": (3600.0, {"s": 1}),
    "Hz": (1.0, {"s": -1}),
    "m": (1.0, {"m": 1}),
    "in": (0.0254, {"m": 1}),
    "g": (1e-3, {"kg": 1}),
    "A": (1.0, {"A": 1}),
    "N": _NEWTON,
    "oz": (0.27801385, _NEWTON[1]),
    "lbf": (4.4482216, _NEWTON[1]),
    **{name: (size, {"rad": 1}) for name, size in ANGLE_UNITS.items()},
    "rpm": (2.0 * math.pi / 60.0, {"rad": 1, "s": -1}),
    "counts": (1.0, {"counts": 1}),
    "lines": (4.0, {"counts": 1}),
    "cpr": (1.0 / (2.0 * math.pi), {"counts": 1, "rad": -1}),
    "ppr": (4.0 / (2.0 * math.pi), {"counts": 1, "rad": -1}),
    "bits": (1.0, {"bits": 1}),
    "bytes": (1.0, {"bytes": 1}),
    "ticks": (1.0, {"ticks": 1}),
    "period": (1.0, {"period": 1}),
    "exchanges": (1.0, {"exchanges": 1}),
}
_PREFIXES: Final = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
_PREFIXED: Final = frozenset({"s", "m", "g", "A", "N", "Hz", "bytes"})
_SPELLINGS: Final = {
    "tick": "ticks",
    "count": "counts",
    "bit": "bits",
    "byte": "bytes",
    "B": "bytes",
    "kB": "kbytes",
    "MB": "Mbytes",
    "GB": "Gbytes",
    "degree": "deg",
    "degrees": "deg",
    "radian": "rad",
    "radians": "rad",
    "turn": "rev",
    "turns": "rev",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "amp": "A",
    "amps": "A",
    "ampere": "A",
    "periods": "period",
    "RPM": "rpm",
    "hz": "Hz",
    "khz": "kHz",
    "ozf": "oz",
}
_SIGNS: Final = str.maketrans(
    {"µ": "u", "μ": "u", "²": "2", "³": "3", "°": "deg", "·": " ", "*": " ", "^": "", "⋅": " "}
)
_JOINED: Final = re.compile(r"([mukc]?N|[mk]?g|oz)([cm]?m|in)(2?)")
"""Nm, mNm, Ncm, gcm2, ozin: two units without a space between them."""
_TOKEN: Final = re.compile(r"([A-Za-z]+)(-?\d*)")
_WRITTEN: Final = re.compile(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(|[^\d\s+\-.,:/].*?)\s*")
_DIGITS: Final = 12

_Size = tuple[float, frozenset[tuple[str, int]]]


class UnitError(ValueError):
    """A quantity is invalid, or has a unit of another quantity; the text says what is valid."""

    @property
    def about(self) -> str:
        """The text without the quantity, for a message that shows it elsewhere."""
        return re.sub(r"^'[^']*':? ", "", str(self))


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
    return value, spelled(unit)


def spelled(unit: str) -> str:
    """A unit in the spelling of this module: ``Nm/°`` is ``N m/deg``, ``[µs]`` is ``us``; an unknown unit is unchanged."""
    plain = unit.strip().strip("[]()").translate(_SIGNS)
    return "/".join(" ".join(_words(part)) for part in plain.split("/")) if plain else ""


def _words(part: str) -> list[str]:
    words: list[str] = []
    for word in part.split():
        joined = _JOINED.fullmatch(word) if word not in _ATOMS else None
        words += [joined[1], joined[2] + joined[3]] if joined else [_SPELLINGS.get(word, word)]
    return words


@cache
def _size(unit: str) -> _Size | None:
    """A unit in SI, and its dimensions; None for an unknown one."""
    size, dimensions = 1.0, Counter[str]()
    for place, part in enumerate(spelled(unit).split("/")):
        for word in part.split():
            if word == "1":
                continue
            found = _TOKEN.fullmatch(word)
            atom = _atom(found[1]) if found else None
            if found is None or atom is None:
                return None
            power = int(found[2] or 1) * (-1 if place else 1)
            size *= atom[0] ** power
            dimensions.update({name: power * times for name, times in atom[1].items()})
    return size, frozenset((name, power) for name, power in dimensions.items() if power)


def _atom(name: str) -> tuple[float, Mapping[str, int]] | None:
    if name in _ATOMS:
        return _ATOMS[name]
    if name[:1] in _PREFIXES and name[1:] in _PREFIXED:
        size, dimensions = _ATOMS[name[1:]]
        return _PREFIXES[name[0]] * size, dimensions
    return None


def in_unit(text: str, unit: str, config: Config | None = None, *, bare: str = "") -> float:
    """Convert a quantity to a unit, such as ``N m/rad``.

    Args:
        text: the quantity. unit: of the result.
        config: of the device, for the size of ticks and counts; without it they cannot be converted to rad or m.
        bare: unit of a number without a unit; empty for `unit`.

    Raises:
        UnitError: no finite number, an unknown unit, or a unit of another quantity.
    """
    value, own = split(text)
    own = own or bare
    if not own or spelled(own) == spelled(unit):
        return value
    wanted, given = _size(unit), _size(own)
    if unit == "counts/rev" and own in ("counts", "lines"):  # data sheets leave "a revolution" out
        given = _size(f"{own}/rev")
    if config is not None:
        wanted, given = (size and _placed(size, config) for size in (wanted, given))
    if given is None:
        raise UnitError(f"{text!r}: unknown unit {own!r}; give it in {unit or 'no unit'}")
    if wanted is None or wanted[1] != given[1]:
        raise UnitError(f"{text!r} is another quantity; give it in {unit or 'no unit'}")
    return float(f"{value * given[0] / wanted[0]:.{_DIGITS}g}")


def _placed(size: _Size, config: Config) -> _Size:
    """A unit with ticks and counts converted to rad or m of the device."""
    factor, dimensions = size[0], Counter(dict(size[1]))
    for name, place in zip(_OF_THE_ENCODER, (config.resolution, config.raw_resolution), strict=True):
        power = dimensions.pop(name, 0)
        factor *= place**power
        dimensions["m" if config.is_linear else "rad"] += power
    return factor, frozenset((name, power) for name, power in dimensions.items() if power)


def deflection_ticks(asked: float | str, config: Config) -> float:
    """A deflection in coarse ticks; a bare number is in ticks.

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
    """A velocity in coarse ticks per servo period; a bare number is in that unit.

    Raises:
        UnitError: as in :func:`deflection_ticks`; or the unit is not a speed.
    """
    if not isinstance(asked, str):
        return asked
    value, unit = split(asked)
    place, slash, time = ("rev", "/", "min") if unit == "rpm" else (unit or "ticks/period").partition("/")
    times = {**TIME_UNITS, "period": config.period}
    if not slash or time not in times:
        per = ", ".join(times)
        raise UnitError(f"{asked!r} is not a velocity: write a unit such as rad/s or mm/s (times: {per}), or rpm")
    return value * _of_place(place, asked, config, per=time) / config.resolution * config.period / times[time]


def seconds(asked: float | str) -> float:
    """A duration in s; a bare number is in s.

    Raises:
        UnitError: no number, or an unknown unit.
    """
    if not isinstance(asked, str):
        return asked
    value, unit = split(asked)
    return value * _factor(unit or "s", asked, {**TIME_UNITS, "h": 3600.0})


def amplitude(asked: float | str, config: Config, *, moves_origin: bool) -> float:
    """Amplitude of an excitation in A, or in rad or m if it moves the spring's origin; a bare number is in that unit.

    Raises:
        UnitError: as in :func:`deflection_ticks`; or a current instead of a position, or the reverse.
    """
    if not isinstance(asked, str):
        return asked
    value, unit = split(asked)
    if not unit:
        return value
    return value * (_of_place(unit, asked, config) if moves_origin else _factor(unit, asked, CURRENT_UNITS))


def _of_place(unit: str, asked: str, config: Config, *, per: str = "") -> float:
    """Factor of a unit of position to rad or m; `per`: the unit of time, if it is part of a speed, for the message."""
    own, other = (LENGTH_UNITS, ANGLE_UNITS) if config.is_linear else (ANGLE_UNITS, LENGTH_UNITS)
    encoder = dict(zip(_OF_THE_ENCODER, (config.resolution, config.raw_resolution), strict=True))
    here = {**own, **encoder}
    if unit in other:
        kind, wanted = ("linear", "length") if config.is_linear else ("rotary", "angle")
        units = [f"{name}/{per}" for name in here] + ["rpm"] * (not config.is_linear) if per else [*here]
        raise UnitError(f"{asked!r}: the device is {kind}; give {'speed' if per else wanted}s in {', '.join(units)}")
    return _factor(unit, asked, here, per=per)


def _factor(unit: str, asked: str, units: Mapping[str, float], *, per: str = "") -> float:
    if unit not in units:
        near = nearest_name(unit, units)
        time = f"/{per}" if per else ""
        hint = f"did you mean {near}{time}? " if near else ""
        listed = ", ".join(f"{name}{time}" for name in units)
        raise UnitError(f"{asked!r}: unknown unit {unit!r}; {hint}units here: {listed}")
    return units[unit]
