"""Metrics in Prometheus' text format 0.0.4, as a file that node_exporter's textfile collector reads."""

from __future__ import annotations

import re
from pathlib import Path

from hapticd.figures.files import atomic_write

_SAMPLE = re.compile(r"^([a-zA-Z_:][a-zA-Z0-9_:]*)(?:\{(.*)\})? (\S+)$", re.MULTILINE)


def up(value: bool) -> str:
    """The metric that says whether the daemon answered."""
    return f"# HELP hapticd_up 1 when the daemon answered\n# TYPE hapticd_up gauge\nhapticd_up {value:d}\n"


def labelled(text: str, testbed: str | None) -> str:
    """The text with a label ``testbed`` in front of every sample's own labels; unchanged for None."""
    if testbed is None:
        return text
    value = testbed.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")

    def add(found: re.Match[str]) -> str:
        name, labels, number = found.groups()
        return f'{name}{{testbed="{value}"{"," + labels if labels else ""}}} {number}'

    return _SAMPLE.sub(add, text)


def samples(text: str) -> dict[str, float]:
    """Each sample's value by its name with labels."""
    return {f"{name}{{{labels}}}" if labels else name: float(value) for name, labels, value in _SAMPLE.findall(text)}


def replace(path: Path, text: str) -> None:
    """Put a readable file in place by renaming: the collector sees the old text or the new one, never half of it.

    Raises:
        OSError: the folder is not there or not writable.
    """
    with atomic_write(path) as part:
        part.write_text(text)
        part.chmod(0o644)
