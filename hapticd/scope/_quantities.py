"""Numbers as they were typed into the page, read as the command line reads its own (`hapticd.config.units`).

The page sends a field's text as it stands, with the unit written beside the field: ``{"text": "5mm", "unit": "ticks"}``.
What cannot be read is refused with the name of its field, before the daemon is asked for anything; nothing is put in its
place.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hapticd.config import Config, unit_of
from hapticd.config.text import plain_number
from hapticd.config.units import UnitError, in_unit
from hapticd.scope.forms import BadRequest
from hapticd.scope.theory import excitations

_POSITIVE = frozenset({"duration_s", "amplitude", "low_hz", "high_hz"})


def read_quantities(fields: Mapping[str, Any], units: Mapping[str, str], config: Config) -> dict[str, float]:
    """The numbers of fields.

    Args:
        fields: name → ``{"text", "unit"}``. units: name → the unit that is wanted. config: in force.

    Raises:
        BadRequest: with every field that cannot be read.
    """
    numbers, problems = {}, []
    for name, said in fields.items():
        try:
            numbers[name] = _read(said, units[name], config)
            if name in _POSITIVE and numbers[name] <= 0.0:
                raise UnitError(f"{said['text']!r} is not above zero")
        except UnitError as error:
            problems.append({"key": name, "message": str(error)})
    if problems:
        words = "; ".join(f"{each['key']}: {each['message']}" for each in problems)
        raise BadRequest(422, "quantity", words, problems)
    return numbers


def read_plan(name: str, plan: Mapping[str, Any], config: Config) -> dict[str, float]:
    """The numbers of an excitation's form; what the daemon is to choose is left out of it.

    Raises:
        BadRequest: as in `read_quantities`, or the excitation has no such number.
    """
    known = next((each["plan"] for each in excitations(config) if each["name"] == name), plan)
    if unknown := plan.keys() - known.keys():
        raise BadRequest(422, "request", f"{name}: there is no {min(unknown)}")
    return read_quantities(plan, {key: known[key]["unit"] for key in plan}, config)


def read_settings(settings: Mapping[str, Any], config: Config) -> dict[str, Any]:
    """Settings for the daemon: what was typed as a number of the key's own unit, all else as it is.

    Raises:
        BadRequest: as in `read_quantities`.
    """
    typed = {key: said for key, said in settings.items() if isinstance(said, Mapping)}
    units = {key: setting_unit(key, config) for key in typed}
    numbers = read_quantities(typed, units, config)
    return {key: plain_number(numbers[key]) if key in numbers else said for key, said in settings.items()}


def setting_unit(key: str, config: Config) -> str:
    """The unit of a setting's number: that of its key, as it is with the other settings in force."""
    if key == "dither.amplitude":
        return "A" if config.dither.target == "current" else "ticks"
    return unit_of(key, config.is_linear)


def _read(said: Any, unit: str, config: Config) -> float:
    text, bare = (said.get("text"), said.get("unit")) if isinstance(said, Mapping) else (None, None)
    if not isinstance(text, str) or not isinstance(bare, str):
        raise BadRequest(422, "request", "a quantity is an object of a text and the unit of its bare number")
    if not text.strip():
        raise UnitError(f"nothing is typed; give a number, in {bare or unit or 'no unit'}")
    return in_unit(text, unit, config, bare=bare)
