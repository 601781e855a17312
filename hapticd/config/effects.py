"""The effects of a plant model, and their check against the catalogue."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from hapticd.config.fields import MAGNITUDE, is_quantity
from hapticd.config.nearest import nearest_name
from hapticd.config.problems import NO_VALUE, Finding
from hapticd.config.text import bound_text
from hapticd.effects.catalogue import BROKEN, CATALOGUE, EFFECT_SLUGS
from hapticd.effects.spec import Parameter


class Effect(BaseModel):
    """One effect of a plant model: its slug and its parameters, as extra fields."""

    model_config = ConfigDict(frozen=True, extra="allow")

    name: str = Field(description="Slug of the effect", json_schema_extra={"enum": list(EFFECT_SLUGS)})


def checked_effects(effects: list[Any] | tuple[Any, ...]) -> tuple[dict[str, Any], ...]:
    """Valid effects in the form of a configuration: with floats, and tuples of floats."""
    return tuple({key: _plain(value) for key, value in _fields(effect).items()} for effect in effects)


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return value
    return tuple(float(item) + 0.0 for item in value) if isinstance(value, list | tuple) else float(value) + 0.0


def _fields(effect: Any) -> Mapping[str, Any]:
    return effect.model_dump() if isinstance(effect, Effect) else effect


def effect_findings(effects: object) -> Iterator[Finding]:
    """Problems of the value of ``plant.effects``; keys are relative to it (``[0].name``)."""
    if not isinstance(effects, list | tuple):
        yield Finding("", effects, "must be a list of effects, such as [{name: stribeck, s: 0.4, omega_s: 3}]")
        return
    seen: dict[str, int] = {}
    for index, given in enumerate(effects):
        effect, key = _fields(given), f"[{index}]"
        if not (isinstance(effect, Mapping) and isinstance(effect.get("name"), str)):
            yield Finding(key, given, "must be a mapping with the effect's name, such as {name: stribeck}")
            continue
        slug = effect["name"]
        if slug not in CATALOGUE:
            yield _unknown(f"{key}.name", slug)
            continue
        if slug in seen:
            yield Finding(f"{key}.name", slug, f"given twice, here and as plant.effects[{seen[slug]}]")
        elif other := next((other for other in seen if _exclude_each_other(slug, other)), None):
            yield Finding(f"{key}.name", slug, f"excludes {other}, plant.effects[{seen[other]}]; give one of them")
        seen.setdefault(slug, index)
        yield from _parameter_findings(key, slug, effect)


def _unknown(key: str, slug: str) -> Finding:
    if slug in BROKEN:
        return Finding(key, slug, f"cannot be used: {BROKEN[slug]}", EFFECT_SLUGS)
    close = nearest_name(slug, EFFECT_SLUGS)
    hint = f"did you mean {close}?" if close else "known effects: " + ", ".join(EFFECT_SLUGS)
    return Finding(key, slug, f"unknown effect; {hint}", EFFECT_SLUGS, close)


def _exclude_each_other(one: str, other: str) -> bool:
    return one in CATALOGUE[other].excludes or other in CATALOGUE[one].excludes


def _parameter_findings(key: str, slug: str, effect: Mapping[str, object]) -> Iterator[Finding]:
    parameters = {parameter.name: parameter for parameter in CATALOGUE[slug].parameters}
    wrong = False
    for name, value in effect.items():
        if name == "name":
            continue
        if name not in parameters:
            close = nearest_name(str(name), parameters)
            hint = f"did you mean {close}?" if close else "valid: " + ", ".join(parameters)
            yield Finding(f"{key}.{name}", NO_VALUE, f"unknown parameter of {slug}; {hint}", tuple(parameters), close)
            continue
        for finding in _value_findings(f"{key}.{name}", parameters[name], value):
            wrong = True
            yield finding
    for name, parameter in parameters.items():
        if parameter.required and name not in effect:
            wrong = True
            needed = ", ".join(other.name for other in parameters.values() if other.required)
            yield Finding(f"{key}.{name}", NO_VALUE, f"is missing; {slug} needs {needed}")
    if not wrong:
        yield from _joint_findings(key, slug, effect)


def _value_findings(key: str, parameter: Parameter, value: object) -> Iterator[Finding]:
    if parameter.length == 1:
        yield from _number_findings(key, parameter, value)
    elif not isinstance(value, list | tuple):
        yield Finding(key, value, f"must be a list of up to {parameter.length} numbers{_in(parameter)}")
    elif not 1 <= len(value) <= parameter.length:
        message = f"has {len(value)} numbers; must have 1 to {parameter.length}"
        yield Finding(key, NO_VALUE, message, float(parameter.length))
    else:
        for index, item in enumerate(value):
            yield from _number_findings(f"{key}[{index}]", parameter, item)


def _number_findings(key: str, parameter: Parameter, value: object) -> Iterator[Finding]:
    unit = parameter.unit or None
    if isinstance(value, bool) or not isinstance(value, Real):
        yield Finding(key, value, f"must be a number{_in(parameter)}", unit=unit)
        return
    number = _finite(value)
    if number is None:
        yield Finding(key, value, "must be finite", unit=unit)
    elif number < parameter.lower:
        message = f"must be at least {bound_text(parameter.lower)} {_unit(parameter)}".rstrip()
        yield Finding(key, value, message, parameter.lower, unit=unit)
    elif number > parameter.upper:
        message = f"must be at most {bound_text(parameter.upper)} {_unit(parameter)}".rstrip()
        yield Finding(key, value, message, parameter.upper, unit=unit)
    elif not is_quantity(number):
        yield Finding(key, value, f"{MAGNITUDE} {_unit(parameter)}".rstrip() + " in magnitude", unit=unit)


def _finite(value: Real) -> float | None:
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _unit(parameter: Parameter) -> str:
    if parameter.unit == parameter.unit_linear:
        return parameter.unit
    return f"{parameter.unit} ({parameter.unit_linear} on a linear device)"


def _in(parameter: Parameter) -> str:
    return f" in {_unit(parameter)}" if parameter.unit else ""


def _joint_findings(key: str, slug: str, effect: Mapping[str, Any]) -> Iterator[Finding]:
    check = CATALOGUE[slug].joint_check
    for name, message, limit, unit in check(effect) if check else ():
        given = effect.get(name)
        value = given if isinstance(given, Real) else NO_VALUE
        yield Finding(f"{key}.{name}", value, message, limit, unit=unit)
