"""Configurations that come with hapticd: the RE35 testbed, the devices of the paper's Table II, and common rigs."""

from __future__ import annotations

from pathlib import Path

PRESETS = Path(__file__).parent


def preset_names() -> tuple[str, ...]:
    """Names that ``load_config`` and the commands accept instead of a file; the default comes first."""
    names = (path.stem for path in PRESETS.glob("*.yaml"))
    return tuple(sorted(names, key=lambda name: (name != "re35", name)))
