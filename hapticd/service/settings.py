"""Which keys of two configurations differ, and which of them may change while the daemon runs."""

from __future__ import annotations

from typing import Any

from hapticd.config import LIVE_KEYS, Config


def changed_keys(old: Config, new: Config) -> dict[str, Any]:
    """Dotted keys whose values differ, with the new values."""
    before, after = _flat(old.model_dump(mode="json")), _flat(new.model_dump(mode="json"))
    return {key: after.get(key) for key in before.keys() | after.keys() if before.get(key) != after.get(key)}


def _flat(section: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def is_live(key: str) -> bool:
    """Whether a dotted key may change between two ticks; the others need a new rig or a restart."""
    return key in LIVE_KEYS or any(pattern.endswith(".*") and key.startswith(pattern[:-1]) for pattern in LIVE_KEYS)
