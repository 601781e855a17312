"""A configuration from whatever a caller has: a file, a preset, plain data, or one already read."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from hapticd.config.loading import apply_settings, load_config, parse_config
from hapticd.config.model import Config

ConfigSource = Config | Mapping[str, Any] | str | PathLike[str] | None


def config_of(source: ConfigSource = None, settings: Mapping[str, Any] | None = None) -> Config:
    """Resolve a configuration.

    Args:
        source: a `Config`; nested mappings as a YAML file holds them; a file's path; the name of a preset; None for re35.
        settings: dotted key to value, applied to it, e.g. ``{"spring.stiffness": 0.02}``.

    Raises:
        ConfigError: with everything that is wrong.
    """
    if isinstance(source, Config):
        config = source
    elif isinstance(source, Mapping):
        config = parse_config(source, "the given config")
    else:
        config = load_config(source if source is None or isinstance(source, str) else Path(source))
    return apply_settings(config, settings, source="settings") if settings else config
