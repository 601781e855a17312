"""Numbers with a unit in plain data: ``3 mN m/rad`` where a key has the unit N m/rad becomes 0.003."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from hapticd.config.keys import leaf_fields, unit_of
from hapticd.config.problems import Problem
from hapticd.config.text import shown
from hapticd.config.units import UnitError, in_unit, split
from hapticd.effects.catalogue import CATALOGUE


def with_units(data: dict[str, Any], source: str, linear: bool) -> Iterator[Problem]:
    """Replace texts with a number and a unit by numbers; a value with a wrong unit is removed, and reported.

    Args:
        data: nested dicts and lists, changed in place. source: its name in messages. linear: a linear device.
    """
    for key in leaf_fields():
        *sections, leaf = key.split(".")
        place: Any = data
        for section in sections:
            place = place.get(section) if isinstance(place, dict) else None
        if isinstance(place, dict) and isinstance(place.get(leaf), str):
            yield from _convert(place, leaf, key, _unit(key, data, linear), source)
    plant = data.get("plant")
    effects = plant.get("effects") if isinstance(plant, dict) else None
    for number, effect in enumerate(effects if isinstance(effects, list) else ()):
        found = (
            CATALOGUE.get(effect["name"]) if isinstance(effect, dict) and isinstance(effect.get("name"), str) else None
        )
        for parameter in found.parameters if found else ():
            place, unit = effect, parameter.unit_linear if linear else parameter.unit
            key = f"plant.effects[{number}].{parameter.name}"
            if isinstance(place.get(parameter.name), str):
                yield from _convert(place, parameter.name, key, unit, source)
            elif isinstance(values := place.get(parameter.name), list):
                for at, value in enumerate(values):
                    if isinstance(value, str):
                        yield from _convert(values, at, f"{key}[{at}]", unit, source)


def _unit(key: str, data: dict[str, Any], linear: bool) -> str:
    if key != "dither.amplitude":
        return unit_of(key, linear)
    dither = data.get("dither")
    return "A" if isinstance(dither, dict) and dither.get("target") == "current" else "ticks"


def _convert(place: Any, at: Any, key: str, unit: str, source: str) -> Iterator[Problem]:
    text = place[at]
    try:
        if not unit or not split(text)[1]:  # words, and numbers in quotes, are checked by the schema
            return
    except UnitError:
        return
    try:
        place[at] = in_unit(text, unit)
    except UnitError as error:
        yield Problem(source, key, shown(text), error.about, unit=unit)
        place[at] = 0.0 if isinstance(place, list) else None
        if isinstance(place, dict):
            del place[at]
