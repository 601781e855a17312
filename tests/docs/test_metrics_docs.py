"""Dashboard and reference page against the metrics that the daemon really has."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families

from hapticd.client import textfile
from tests.service.daemons import daemon_on, state_home

from .snippets import ROOT, snippets

__all__ = ["state_home"]

DASHBOARD = json.loads((ROOT / "systemd/grafana-dashboard.json").read_text(encoding="utf-8"))
FROM_NODE_EXPORTER = {"node_textfile_mtime_seconds"}


@pytest.fixture
def samples(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, set[str]]:
    """Every sample's name and the names of its labels, as node_exporter gets them."""
    with daemon_on(monkeypatch, tmp_path, safety={"passivity": "observe"}) as (daemon, _devices):
        text = textfile.labelled(daemon.metrics() + textfile.up(True), "left")
    found: dict[str, set[str]] = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            found.setdefault(sample.name, set()).update(sample.labels)
    return found


def expressions() -> Iterator[str]:
    for panel in DASHBOARD["panels"]:
        yield from (target["expr"] for target in panel["targets"])
    yield from (note["expr"] for note in DASHBOARD["annotations"]["list"] if "expr" in note)
    for block in snippets(ROOT / "docs/how-to/monitor.md"):
        if block.language == "yaml":
            rules: dict[str, Any] = yaml.safe_load(block.body)
            yield from (rule["expr"] for group in rules.get("groups", ()) for rule in group["rules"])


def test_every_expression_asks_for_metrics_and_labels_that_exist(samples: dict[str, set[str]]) -> None:
    asked = list(expressions())
    assert len(asked) > 20
    for expression in asked:
        names = set(re.findall(r"\b(?:hapticd|node)_\w+", re.sub(r'"[^"]*"', "", expression)))
        assert names, expression
        for name in names - FROM_NODE_EXPORTER:
            assert name in samples, f"{name} in {expression}"
            (selector,) = set(re.findall(rf"{name}(?:\{{([^}}]*)\}})?", expression)) - {""} or {""}
            labels = set(re.findall(r"(\w+)\s*=~?", selector))
            assert labels <= samples[name], f"{labels} of {name} in {expression}"


def test_every_metric_is_on_the_dashboard_and_on_the_reference_page(samples: dict[str, set[str]]) -> None:
    families = {re.sub(r"_(bucket|count|sum|created)$", "", name) for name in samples}
    on_dashboard = {
        re.sub(r"_bucket$", "", name) for text in expressions() for name in re.findall(r"hapticd_\w+", text)
    }
    assert families <= on_dashboard
    page = (ROOT / "docs/reference/metrics.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w+)`", page, re.M)) == families


def test_dashboard_can_be_imported() -> None:
    """What Grafana's import page asks for: declared inputs and panels, unique ids, a grid without overlaps."""
    (source,) = DASHBOARD["__inputs"]
    panels = DASHBOARD["panels"]
    assert DASHBOARD["id"] is None
    assert len({panel["id"] for panel in panels}) == len(panels)
    assert {panel["type"] for panel in panels} == {
        entry["id"] for entry in DASHBOARD["__requires"] if entry["type"] == "panel"
    }
    taken: set[tuple[int, int]] = set()
    for panel in panels:
        assert panel["datasource"]["uid"] == f"${{{source['name']}}}"
        place = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert place["x"] + place["w"] <= 24
        assert not cells & taken
        taken |= cells
