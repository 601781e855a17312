"""Names that somebody else has chosen: a terminal shows them, and obeys none of them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hapticd.cli import output

from .conftest import Run

TITLE = "\x1b]0;owned\x07"
NASTY = {
    f"a{TITLE}.arrow": r"a\x1b]0;owned\x07.arrow",
    "b\x9b2J.arrow": r"b\x9b2J.arrow",
    "c\nhapticd: all is well.arrow": r"c\nhapticd: all is well.arrow",
    "d\rgone.arrow": r"d\rgone.arrow",
    "e\u202eworra.arrow": r"e\u202eworra.arrow",
    "f\udc80.arrow": r"f\udc80.arrow",
    "gut µ 末.arrow": "gut µ 末.arrow",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in NASTY:
        (tmp_path / name).write_bytes(b"no run")
    return tmp_path


def test_runs_shows_what_is_in_a_name_and_a_line_for_each(hapticd: Run, folder: Path) -> None:
    lines = hapticd("runs", str(folder)).out.splitlines()
    assert len(lines) == len(NASTY) + 1
    for shown in NASTY.values():
        assert sum(f"  {shown}  (" in line for line in lines) == 1


def test_as_data_the_names_are_whole(hapticd: Run, folder: Path) -> None:
    outcome = hapticd("runs", str(folder), "--json")
    assert {os.path.basename(run["path"]) for run in outcome.document["runs"]} == set(NASTY)  # noqa: PTH119 - a surrogate stays
    assert "\x1b" not in outcome.out
    assert "\x9b" not in outcome.out


@pytest.mark.parametrize("words", [("verify",), ("plot",), ("export", "--to", "csv")])
def test_no_command_says_it_in_an_error_either(hapticd: Run, folder: Path, words: tuple[str, ...]) -> None:
    outcome = hapticd(*words, str(folder / f"a{TITLE}.arrow"))
    assert outcome.code == 2
    assert r"a\x1b]0;owned\x07.arrow" in outcome.err
    assert "\x1b" not in outcome.out + outcome.err


def test_a_whole_file_of_such_a_name_is_verified_in_one_line(hapticd: Run, tmp_path: Path) -> None:
    path = tmp_path / f"a{TITLE}\n.arrow"
    whole = tmp_path / "whole.arrow"
    assert hapticd("simulate", "--duration", "0.05", "-o", str(whole)).code == 0
    whole.rename(path)
    outcome = hapticd("verify", str(path))
    assert outcome.out.count("\n") == 1
    assert r"a\x1b]0;owned\x07\n.arrow: " in outcome.out


def test_text_keeps_its_lines_and_a_name_is_one() -> None:
    assert output.printable("one\ntwo µ 末") == "one\ntwo µ 末"
    assert output.name(Path("one\n\ttwo")) == r"one\n\ttwo"
    assert len(output.printable("long\x07" * 10_000)) == 80_000
