"""Converts pydantic's errors to problems of a configuration: key path, value, limit, unit, nearest key."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from hapticd.config.keys import extra_text, leaf_fields, section_models, unit_of, valid_keys
from hapticd.config.nearest import nearest_key, nearest_name
from hapticd.config.problems import NO_VALUE, Finding, Limit, Problem
from hapticd.config.text import bound_text, decimal_comma, shown, yaml_value

_BOUNDS = {
    "greater_than_equal": ("at least", "ge"),
    "greater_than": ("above", "gt"),
    "less_than_equal": ("at most", "le"),
    "less_than": ("below", "lt"),
}


def explain(error: ValidationError, file: str, linear: bool) -> list[tuple[Problem, frozenset[str]]]:
    """Problems of a validation, each with the other keys that it depends on."""
    return [found for details in error.errors(include_url=False) for found in _explain(details, file, linear)]


def key_path(location: tuple[int | str, ...]) -> str:
    """Dotted key of a pydantic location: ``("plant", "effects", 0)`` is ``plant.effects[0]``."""
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}"
    return path.removeprefix(".")


def _explain(details: ErrorDetails, file: str, linear: bool) -> Iterator[tuple[Problem, frozenset[str]]]:
    key = key_path(details["loc"])
    context: Mapping[str, Any] = details.get("ctx", {})
    if details["type"] == "findings":
        for finding in context["findings"]:
            yield _from_finding(finding, key, file, linear), finding.involves
    elif details["type"] in ("extra_forbidden", "invalid_key"):
        yield unknown_key(key, file), frozenset()
    elif key in section_models() or not key:
        yield Problem(file, key, shown(details["input"]), _section_message(key, details["input"])), frozenset()
    else:
        message, limit, nearest = _value_message(details, key, linear)
        unit = unit_of(key, linear) or None
        yield Problem(file, key, shown(details["input"]), message, limit, unit, nearest), frozenset()


def unknown_key(key: str, file: str) -> Problem:
    """The problem of an unknown key, with the key that was probably meant."""
    nearest = nearest_key(key, valid_keys())
    section = key.rpartition(".")[0]
    siblings = [other for other in valid_keys() if other.rpartition(".")[0] == section]
    if nearest:
        hint = f"; did you mean {nearest}?"
    elif siblings:
        place = f"in {section}" if section else "here"
        hint = f"; valid {place}: {', '.join(other.rpartition('.')[2] for other in siblings)}"
    else:
        hint = ""
    return Problem(file, key, None, f"unknown key{hint}", nearest=nearest)


def _from_finding(finding: Finding, key: str, file: str, linear: bool) -> Problem:
    joint = "" if not key or not finding.key or finding.key.startswith("[") else "."
    full = f"{key}{joint}{finding.key}"
    value = None if finding.value is NO_VALUE else shown(finding.value)
    unit = finding.unit or unit_of(full, linear) or None
    return Problem(file, full, value, finding.message, finding.limit, unit, finding.nearest)


def _section_message(key: str, value: object) -> str:
    if not key:
        return "must be a mapping of sections, such as servo: {rate_hz: 1000}"
    keys = [leaf for leaf in leaf_fields() if leaf.startswith(f"{key}.")]
    example = keys[0].removeprefix(f"{key}.")
    message = f"must be a section of keys, such as {key.rpartition('.')[2]}: {{{example}: …}}"
    if isinstance(value, str) and value.partition(":")[0] in section_models()[key].model_fields and ":" in value:
        message += "; put a space after the colon"
    return message


def _value_message(details: ErrorDetails, key: str, linear: bool) -> tuple[str, Limit, str | None]:
    kind, value = details["type"], details["input"]
    context: Mapping[str, Any] = details.get("ctx", {})
    field = leaf_fields()[key]
    unit = unit_of(key, linear)
    if kind in _BOUNDS:
        words, name = _BOUNDS[kind]
        bound = context[name]
        zero = extra_text(field, "zero_or_null")
        suffix = f" (0 or null: {zero})" if zero and bound == 0 else ""
        return f"must be {words} {bound_text(bound)} {unit}".rstrip() + suffix, bound, None
    if kind == "literal_error":
        allowed = tuple(str(name) for name in get_args(field.annotation))
        nearest = nearest_name(value, allowed) if isinstance(value, str) else None
        hint = f"; did you mean {nearest}?" if nearest else ""
        return f"must be one of {', '.join(allowed)}{hint}", allowed, nearest
    if kind in ("not_a_number", "not_whole", "not_finite"):
        return _number_message(kind, value, unit, extra_text(field, "zero_or_null")), None, None
    if kind == "no_quantity":
        return f"{details['msg']} {unit}".rstrip() + " in magnitude", None, None
    if kind == "bool_type":
        return "must be true or false", ("true", "false"), None
    if kind == "string_type":
        return "must be text", None, None
    return details["msg"], None, None


def _number_message(kind: str, value: object, unit: str, zero: str) -> str:
    if kind == "not_finite":
        return "must be finite" + (f" (0 or null: {zero})" if zero else "")
    message = "must be a whole number" if kind == "not_whole" else "must be a number"
    if unit:
        message += f" {'of' if kind == 'not_whole' else 'in'} {unit}"
    if with_point := decimal_comma(value):
        return f"{message}; the decimal sign is a point: {with_point}"
    number = _number_in(value)
    return message if number is None else f"{message}; write {yaml_value(number)} without quotes"


def _number_in(value: object) -> float | None:
    try:
        number = float(value) if isinstance(value, str) else math.nan
    except ValueError:
        return None
    return number if math.isfinite(number) else None
