"""The version of a configuration's keys. An older file is read; a newer one is refused with a remedy."""

from __future__ import annotations

from typing import Any, Final

from hapticd.config.problems import Problem
from hapticd.config.text import shown

VERSION: Final = 1
"""It increases when a key changes its meaning or is removed; `take_version` then converts older files."""


def take_version(data: dict[str, Any], source: str) -> list[Problem]:
    """Remove the key ``version`` from nested mappings; a configuration without it has version 1."""
    version = data.pop("version", 1)
    if type(version) is not int or version < 1:
        return [Problem(source, "version", shown(version), f"is not a version; this hapticd writes {VERSION}")]
    if version <= VERSION:
        return []
    message = f"is from a newer hapticd; this one reads up to version {VERSION}: install the newer one"
    return [Problem(source, "version", str(version), message, limit=VERSION)]
