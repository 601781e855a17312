"""The dotted keys of a configuration, their units, and whether they may change while the loop runs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from pydantic.fields import FieldInfo

from hapticd.config.fields import Section
from hapticd.config.model import Config

_LIVE = (
    "servo.rate_hz",
    "servo.overrun",
    "spring",
    "encoder.decimation",
    "dither",
    "delay",
    "safety",
    "record.subject",
    "record.condition",
)
_FIXED = ("safety.enable",)  # the device is opened with or without its enable input


@cache
def leaf_fields() -> dict[str, FieldInfo]:
    """Every dotted key with a value, in the order of the schema."""
    return {key: found for key, found in _walk(Config, "") if isinstance(found, FieldInfo)}


@cache
def section_models() -> dict[str, type[Section]]:
    """Every dotted key of a section."""
    return {key: found for key, found in _walk(Config, "") if not isinstance(found, FieldInfo)}


def _walk(model: type[Section], prefix: str) -> Iterator[tuple[str, FieldInfo | type[Section]]]:
    sections = model.subsections()
    for name, field in model.model_fields.items():
        yield prefix + name, sections.get(name, field)
        if name in sections:
            yield from _walk(sections[name], f"{prefix}{name}.")


def valid_keys() -> list[str]:
    """Every dotted key, sections included."""
    return [*section_models(), *leaf_fields()]


def extra_text(field: FieldInfo, name: str) -> str:
    """A documentation entry of a field (``unit``, ``unit_linear``, ``zero_or_null``), or empty text."""
    extra = field.json_schema_extra
    return str(extra.get(name, "")) if isinstance(extra, dict) else ""


def unit_of(key: str, linear: bool = False) -> str:
    """Unit of a dotted key, for a rotary or a linear device; empty if it has none."""
    field = leaf_fields().get(key)
    if field is None:
        return ""
    return (extra_text(field, "unit_linear") if linear else "") or extra_text(field, "unit")


LIVE_KEYS: frozenset[str] = frozenset(
    key
    for key in leaf_fields()
    if key not in _FIXED and any(key == live or key.startswith(f"{live}.") for live in _LIVE)
)
"""Dotted keys that may change while the loop runs; other keys need a restart."""
