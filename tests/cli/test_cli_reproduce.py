"""``hapticd reproduce``: options, output and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hapticd.reproduce import build
from hapticd.reproduce.items import Item, Progress

from .conftest import Run


def test_json_is_what_is_written(hapticd: Run, tmp_path: Path) -> None:
    folder = tmp_path / "paper"
    outcome = hapticd("reproduce", "-o", str(folder), "--quick", "--only", "table2", "--only", "fig3", "--json")
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.document.pop("page") == str(folder / "index.html")
    written = json.loads((folder / "numbers.json").read_text())
    assert written.items() <= outcome.document.items()
    assert list(written["items"]) == ["table2", "fig3"]
    assert written["quick"] is True


def test_the_text_counts_and_lists_what_differs(hapticd: Run, tmp_path: Path) -> None:
    outcome = hapticd("reproduce", "-o", str(tmp_path / "paper"), "--only", "table2")
    assert outcome.code == 0
    assert outcome.out.splitlines() == [
        "17 of 18 printed numbers and statements agree",
        "  table2  Freedom 6: β: 0.025 there, 0.004167 here",
        f"page    {tmp_path / 'paper' / 'index.html'}",
    ]


@pytest.mark.parametrize("name", ["fig3.png", "fig3.svg", "numbers.json", "index.html"])
def test_nothing_is_replaced_unasked(hapticd: Run, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("my own")
    outcome = hapticd("reproduce", "-o", str(tmp_path), "--only", "fig3")
    assert (outcome.code, outcome.out) == (2, "")
    assert f"{tmp_path / name} exists; give another name, or --force to replace it" in outcome.err
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "my own")]


def test_a_figure_of_another_item_is_left_alone(hapticd: Run, tmp_path: Path) -> None:
    (tmp_path / "fig3.png").write_text("my own")
    assert hapticd("reproduce", "-o", str(tmp_path), "--only", "table2").code == 0
    assert (tmp_path / "fig3.png").read_text() == "my own"


def test_ctrl_c_leaves_nothing(hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(quick: bool, progress: Progress) -> Item:
        raise KeyboardInterrupt

    monkeypatch.setitem(build.BUILDERS, "fig4", (interrupted, 1.0))
    outcome = hapticd("reproduce", "-o", str(tmp_path / "paper"), "--only", "table1", "--only", "fig4")
    assert (outcome.code, outcome.out) == (130, "")
    assert "interrupted" in outcome.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--output"),
        (("-o", "paper", "--only", "fig10"), "no such table or figure: fig10"),
        (("-o", "file"), "file is a file; -o takes a folder"),
        (("-o", "file/paper"), "file"),
    ],
)
def test_what_cannot_be_meant_exits_2(
    hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    outcome = hapticd("reproduce", *words)
    assert (outcome.code, outcome.out) == (2, "")
    assert said in outcome.err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
