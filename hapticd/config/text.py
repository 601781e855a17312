"""YAML text of single values, for messages and for written configurations.

Readers of YAML 1.1 and 1.2 give the same result: no bare ``1e-3`` (text in 1.1), no bare ``0660`` (octal in 1.1).
"""

from __future__ import annotations

import contextlib
import itertools
import math
import re
from collections.abc import Mapping
from typing import Any

import yaml

_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_./-]*")
_PYYAML = yaml.representer.SafeRepresenter()
_RESERVED = frozenset({"true", "false", "yes", "no", "on", "off", "y", "n", "null"})


def plain_number(value: float) -> int | float:
    """An integral float as an int, so that 1000.0 and 1000 are written, compared and hashed alike."""
    return int(value) if value.is_integer() and abs(value) < 1e15 else value


def significant(value: float, digits: int = 3) -> str:
    """A number with `digits` significant digits, and never as ``1.3e+02``: 130, 0.0123, 2.5e-06."""
    rounded = f"{value:.{digits}g}"
    return (
        f"{float(rounded):.0f}"
        if 10**digits <= abs(value) < 1e15 or ("e+" in rounded and abs(value) < 1e15)
        else rounded
    )


def decimal_comma(value: object) -> str | None:
    """The number in a text with a decimal comma, written with a point; None for any other value."""
    if not isinstance(value, str) or not _DECIMAL_COMMA.fullmatch(value.strip()):
        return None
    return value.strip().replace(",", ".")


def number_or_text(text: str) -> int | float | str:
    """A finite number if a text is one, else the text."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            if math.isfinite(number := kind(text)):
                return number
    return text


def shortest(value: float) -> str:
    """A number as it would stand in the config."""
    return f"{value:.12g}"


def plainly(value: float) -> str:
    """A value as short as it can be said; what was converted from another unit, to 6 digits."""
    exact, rounded = shortest(value), f"{value:.6g}"
    return exact if len(exact) <= len(rounded) + 2 else rounded


def change_line(name: str, change: Mapping[str, Any]) -> str:
    """One line of a list of changes.

    Args:
        name: of what is changed. change: ``before``, ``after``, ``unit``, and ``words`` of why it is enough.
    """
    values = f"{plainly(change['before'])} → {plainly(change['after'])} {change['unit']}"
    return f"  {name:<20} {values:<32} {change['words']}"


def bound_text(bound: float) -> str:
    """A bound as a person writes it: 20000, 0.05."""
    return str(bound) if isinstance(bound, int) else f"{bound:.15g}"


def yaml_value(value: object) -> str:
    """One line of YAML for a value made of None, bool, int, float, str, lists and mappings; others by ``repr``."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return _float(value)
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{yaml_value(key)}: {yaml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(yaml_value(item) for item in value) + "]"
    return " ".join(repr(value).split())


def legible(text: str, longest: int = 20_000) -> str:
    """A text for a terminal: without control characters except line ends, and cut to `longest` characters."""
    cut = text if len(text) <= longest else f"{text[: longest - 1]}…"
    if all(line.isprintable() for line in cut.split("\n")):
        return cut
    return "".join(sign if sign.isprintable() or sign == "\n" else ascii(sign)[1:-1] for sign in cut)


def shown(value: object, width: int = 60) -> str:
    """A value as it is quoted in a message: YAML text, cut to ``width`` characters."""
    text = yaml_value(_clipped(value, width + 1))
    return text if len(text) <= width else text[: width - 1] + "…"


def _clipped(value: object, width: int) -> object:
    """The value cut to about `width` characters: texts and lists may be huge, and aliases repeat them."""
    if isinstance(value, str):
        return value[:width]
    if isinstance(value, Mapping):
        return {_clipped(key, width): _clipped(item, width) for key, item in itertools.islice(value.items(), width)}
    if isinstance(value, list | tuple):
        return [_clipped(item, width) for item in value[:width]]
    return value


def _float(value: float) -> str:
    number = plain_number(value)
    return str(number) if isinstance(number, int) else str(_PYYAML.represent_float(number).value)


def _string(value: str) -> str:
    if _PLAIN.fullmatch(value) and value.lower() not in _RESERVED:
        return value
    quoted: str = yaml.safe_dump(value, default_style='"', width=float("inf"), allow_unicode=True)
    return quoted.rstrip("\n")


def jitter(seconds: float, period_s: float | None) -> str:
    """Jitter of time stamps in words: below 0.01 % of a period it is the rounding of a number, and none in time."""
    if not period_s:
        return f"jitter {significant(1e6 * seconds)} µs"
    share = seconds / period_s
    if share < 1e-4:
        return "jitter below 0.01 % of a period"
    return f"jitter {significant(1e6 * seconds)} µs ({significant(100 * share)} % of a period)"
