"""Names, kinds and labels of the metrics, and how the command shows them."""

from __future__ import annotations

from pathlib import Path

import pytest
from syrupy.assertion import SnapshotAssertion

from tests.cli.conftest import Run, control, daemon, served
from tests.service.daemons import daemon_on, state_home

__all__ = ["control", "daemon", "served", "state_home"]


def test_metrics(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, snapshot: SnapshotAssertion) -> None:
    """Of a daemon that is off: every line without its value."""
    with daemon_on(monkeypatch, tmp_path, safety={"passivity": "observe"}) as (running, _):
        lines = running.metrics().splitlines()
    assert [line if line.startswith("#") else line.rpartition(" ")[0] for line in lines] == snapshot


WORDS = [
    ("metrics",),
    ("metrics", "--testbed", "left"),
    ("metrics", "--testbed", "left", "-o", "left.prom"),
]


@pytest.mark.parametrize("words", WORDS, ids=" ".join)
def test_words(
    daemon: Run, snapshot: SnapshotAssertion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    """On stdout as text and as JSON, and the file."""
    monkeypatch.chdir(tmp_path)
    text, document = daemon(*words), daemon(*words, "--json")
    files = {path.name: path.read_text().splitlines() for path in tmp_path.glob("*.prom")}
    assert {"code": text.code, "text": text.out.splitlines(), "json": document.document, "files": files} == snapshot
