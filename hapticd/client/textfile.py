"""Metrics in Prometheus' text format 0.0.4, as a file that node_exporter's textfile collector reads."""

from __future__ import annotations

import re

# prometheus_client's parser would lose comments and the numbers' text, and its writer sorts the labels.
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
