"""What a shell completes a word to: configs, settings, experiments and runs (faults: `help`)."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

_CONFIGS = (".yaml", ".yml")
_OFFERED = 20


def complete_config(incomplete: str) -> list[str]:
    """Presets, and YAML files below what is typed."""
    from hapticd.config import preset_names

    return _offered(preset_names(), incomplete, _CONFIGS)


def complete_setting(incomplete: str) -> list[str]:
    """Dotted keys of the config, each with its ``=``."""
    from hapticd.config.keys import valid_keys

    return [f"{key}=" for key in valid_keys() if key.startswith(incomplete)]


def complete_experiment(incomplete: str) -> list[str]:
    """Identification experiments, and YAML files that describe one."""
    from hapticd.servo.excitation import SHAPES

    return _offered(["all", *SHAPES], incomplete, _CONFIGS)


def complete_run(incomplete: str) -> list[str]:
    """Run files that a word may be meant to be: recordings, the newest first, and run files below what is typed."""
    from hapticd.client import recording_folders
    from hapticd.record.listing import run_paths

    names = ["@last", *(path.name for path in run_paths(recording_folders())[:_OFFERED])]
    return _offered(names, incomplete, (".arrow", ".csv", ".parquet"))


def _offered(names: Iterable[str], incomplete: str, suffixes: Collection[str]) -> list[str]:
    """The names, files and folders that a word may be meant to be."""
    here = Path(incomplete).parent if "/" in incomplete else Path()
    places = sorted(here.iterdir()) if here.is_dir() else []
    files = [str(place) for place in places if place.suffix in suffixes]
    folders = [f"{place}/" for place in places if place.is_dir() and not place.name.startswith(".")]
    return [name for name in dict.fromkeys([*names, *files, *folders]) if name.startswith(incomplete)]
