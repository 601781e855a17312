"""What a shell completes a word to: configs, settings and experiments (runs: `run_argument`, faults: `help`)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path


def complete_config(incomplete: str) -> list[str]:
    """Presets, and YAML files below what is typed."""
    from hapticd.config import preset_names

    return _offered(preset_names(), incomplete)


def complete_setting(incomplete: str) -> list[str]:
    """Dotted keys of the config, each with its ``=``."""
    from hapticd.config.keys import valid_keys

    return [f"{key}=" for key in valid_keys() if key.startswith(incomplete)]


def complete_experiment(incomplete: str) -> list[str]:
    """Identification experiments, and YAML files that describe one."""
    from hapticd.servo.excitation import SHAPES

    return _offered(["all", *SHAPES], incomplete)


def _offered(names: Iterable[str], incomplete: str) -> list[str]:
    """The names, YAML files and folders that a word may be meant to be."""
    here = Path(incomplete).parent if "/" in incomplete else Path()
    places = sorted(here.iterdir()) if here.is_dir() else []
    files = [str(place) for place in places if place.suffix in (".yaml", ".yml")]
    folders = [f"{place}/" for place in places if place.is_dir() and not place.name.startswith(".")]
    return [name for name in (*names, *files, *folders) if name.startswith(incomplete)]
