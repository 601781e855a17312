"""Conditions on recordings, as ``hapticd runs --where`` takes them: ``subject=S07``, ``duration_s>2``, ``note~slip``."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, Final

from hapticd.config.keys import leaf_fields
from hapticd.config.nearest import nearest_name
from hapticd.record.listing import Listed, config_of

FIELDS: Final = (
    "file",
    "kind",
    "label",
    "subject",
    "condition",
    "sequence",
    "rows",
    "duration_s",
    "size",
    "whole",
    "note",
)
"""Of a recording, beside the dotted keys of its config."""
_FORM = re.compile(r"\s*([\w.]+)\s*(!=|<=|>=|=|<|>|~)\s*(.*?)\s*", re.DOTALL)
_ORDER: Final[Mapping[str, Callable[[float, float], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


class ConditionError(ValueError):
    """A condition cannot be read; the text says what would be right."""


@dataclass(frozen=True)
class Condition:
    """``key`` of a recording, compared by ``sign`` with ``value``.

    Attributes:
        key: one of `FIELDS`, or a dotted key of the config. sign: ``= != < <= > >=``, or ``~``: contains, whatever the case.
        value: as it was written; a number where both sides are one, in the key's SI unit.
    """

    key: str
    sign: str
    value: str

    def holds(self, recording: Listed) -> bool:
        """Whether it is so; what a recording does not say is equal to nothing and unequal to everything."""
        found = _values(recording, self.key)
        if self.sign == "!=":
            return not any(_equal(value, self.value) for value in found)
        if self.sign == "=":
            return any(_equal(value, self.value) for value in found)
        if self.sign == "~":
            return any(self.value.casefold() in _text(value).casefold() for value in found)
        wanted = float(self.value)
        return any(_ORDER[self.sign](number, wanted) for value in found if (number := _number(value)) is not None)


def read_condition(text: str) -> Condition:
    """A condition, as it is written on the command line.

    Raises:
        ConditionError: it is none, its key is unknown, or it asks which of two texts is the greater.
    """
    found = _FORM.fullmatch(text)
    if found is None:
        raise ConditionError(f"{text!r} is no condition; write KEY=VALUE, or with one of != < <= > >= ~ (contains)")
    key, sign, value = found.groups()
    if key not in FIELDS and key not in leaf_fields():
        near = nearest_name(key, [*FIELDS, *leaf_fields()])
        meant = f"did you mean {near}?" if near else f"it is one of {', '.join(FIELDS)}, or a dotted key of the config"
        raise ConditionError(f"{text!r}: unknown key {key}; {meant}")
    if sign in _ORDER and _number(value) is None:
        raise ConditionError(f"{text!r}: {value!r} is no number, as {sign} needs one")
    return Condition(key, sign, value)


def choose(recordings: Sequence[Listed], conditions: Sequence[Condition]) -> list[Listed]:
    """Those recordings for which all conditions hold."""
    return [each for each in recordings if all(condition.holds(each) for condition in conditions)]


def _values(recording: Listed, key: str) -> list[Any]:
    if key == "file":
        return [recording.path.name]
    if key == "note":
        return [note_text(note) for note in recording.notes]
    if key in FIELDS:
        value = getattr(recording, key)
    else:
        value = reduce(
            lambda section, name: section.get(name, {}) if isinstance(section, dict) else {},
            key.split("."),
            config_of(recording.path),
        )
    return [] if value is None or value == {} else [value]


def note_text(note: Mapping[str, Any]) -> str:
    """A note, or the name and the value of a marker, in one line."""
    if note.get("event") == "note":
        return " ".join(_text(note.get("text")).split())
    value = note.get("value")
    return _text(note.get("name")) if value is None else f"{_text(note.get('name'))} {_text(value)}"


def _equal(value: Any, wanted: str) -> bool:
    left, right = _number(value), _number(wanted)
    return _text(value) == wanted if left is None or right is None else left == right


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _number(value: Any) -> float | None:
    if isinstance(value, bool):
        return None
    try:
        return float(value)
    except (TypeError, ValueError):
        return None
