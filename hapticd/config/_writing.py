"""A configuration as YAML, as a digest, and its schema as JSON Schema."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from hapticd.config._version import VERSION
from hapticd.config.keys import section_models, unit_of
from hapticd.config.model import Config
from hapticd.config.text import plain_number, yaml_value


def config_to_yaml(config: Config, without: Collection[str] = ()) -> str:
    """The whole configuration, `without` some sections, as YAML with units as comments; it reads back as an equal one."""
    data = config.model_dump(exclude=set(without))
    return "\n".join([f"version: {VERSION}", *_lines(data, "", "", config.is_linear)]) + "\n"


def _lines(data: Mapping[str, Any], prefix: str, indent: str, linear: bool) -> Iterator[str]:
    for name, value in data.items():
        key = prefix + name
        if key in section_models():
            yield f"{indent}{name}:"
            yield from _lines(value, f"{key}.", indent + "  ", linear)
        else:
            unit = unit_of(key, linear)
            comment = f"  # {unit}" if unit and value is not None else ""
            yield f"{indent}{yaml_value(name)}: {yaml_value(value)}{comment}"


def config_digest(config: Config) -> str:
    """First 12 hex digits of the SHA-256 of the configuration's canonical JSON.

    The sections ``record`` and ``api`` are excluded: they have paths of one host and do not change the loop, so equal runs
    on two machines have equal digests.
    """
    data = _canonical(config.model_dump(exclude={"record", "api"}))
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _canonical(value: Any) -> Any:
    if isinstance(value, float):
        return plain_number(value)
    if isinstance(value, Mapping):
        return {str(key): _canonical(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_canonical(item) for item in value]
    return value


def config_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a configuration; quantities have ``unit`` (and ``unit_linear`` for linear devices)."""
    schema = Config.model_json_schema()
    meaning = "Of the keys; a file without it is of version 1"
    schema["properties"] = {
        "version": {"type": "integer", "minimum": 1, "maximum": VERSION, "default": 1, "description": meaning},
        **schema["properties"],
    }
    for model in (schema, *schema["$defs"].values()):
        for name, field in model.get("properties", {}).items():
            model["properties"][name] = _accepts_null(field)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "hapticd configuration"}


def _accepts_null(field: dict[str, Any]) -> dict[str, Any]:
    """Accept null for an empty section, an ideal quantity, and a path with a default of this host."""
    if "$ref" in field:
        return {"anyOf": [{"$ref": field["$ref"]}, {"type": "null"}], "description": field["description"]}
    if "type" in field and ("zero_or_null" in field or "default" not in field):
        return {**field, "type": [field["type"], "null"]}
    return field
