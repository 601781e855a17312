"""Metrics in Prometheus' text format 0.0.4, as a file that node_exporter's textfile collector reads."""

from __future__ import annotations

import re

# Not with prometheus_client: its parser loses comments and the text of numbers, and its writer sorts the labels.
_SAMPLE = re.compile(r"^([a-zA-Z_:][a-zA-Z0-9_:]*)(?:\{(.*)\})? (\S+)$", re.MULTILINE)


def up(value: bool) -> str:
    """The metric of whether the daemon answered."""
    return f"# HELP hapticd_up 1 when the daemon answered\n# TYPE hapticd_up gauge\nhapticd_up {value:d}\n"


def labelled(text: str, testbed: str | None) -> str:
    """The text with a label ``testbed`` before the labels of every sample; unchanged for None."""
    if testbed is None:
        return text
    value = testbed.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")

    def add(found: re.Match[str]) -> str:
        name, labels, number = found.groups()
        return f'{name}{{testbed="{value}"{"," + labels if labels else ""}}} {number}'

    return _SAMPLE.sub(add, text)


def samples(text: str) -> dict[str, float]:
    """Name of each sample, with labels, to its value."""
    return {f"{name}{{{labels}}}" if labels else name: float(value) for name, labels, value in _SAMPLE.findall(text)}
