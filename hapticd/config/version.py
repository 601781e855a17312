"""The version of a configuration's keys. An older file is read; a newer one is refused with what to do."""

from __future__ import annotations

from typing import Any, Final

from hapticd.config.problems import Problem
from hapticd.config.text import shown

VERSION: Final = 1
"""Goes up when a key changes its meaning or goes; then what an older file says is translated in `take_version`."""


def take_version(data: dict[str, Any], source: str) -> list[Problem]:
    """Take the key ``version`` out of nested mappings; a configuration without one is of version 1."""
    version = data.pop("version", 1)
    if type(version) is not int or version < 1:
        return [Problem(source, "version", shown(version), f"is no version; this hapticd writes {VERSION}")]
    if version <= VERSION:
        return []
    message = f"is of a newer hapticd, this one reads up to version {VERSION}: install the newer one"
    return [Problem(source, "version", str(version), message, limit=VERSION)]
