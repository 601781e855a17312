"""``hapticd help``: every fault's page, wherever hapticd was installed."""

from __future__ import annotations

from importlib.metadata import PackagePath
from pathlib import Path

import pytest

from hapticd import fault_pages
from hapticd.servo.faults import KINDS, NUMBERS

from .conftest import Run


@pytest.mark.parametrize("code", sorted(NUMBERS))
def test_every_fault_has_a_page_and_a_remedy(hapticd: Run, code: str) -> None:
    shown = hapticd("help", code)
    assert shown.code == 0
    assert shown.out.startswith(f"# {code}\n")
    assert "hapticd clear" in KINDS[NUMBERS[code]].remedy


def test_the_list_has_every_fault_in_one_line_each(hapticd: Run) -> None:
    found = hapticd("help", "--json").document["faults"]
    assert set(found) == set(NUMBERS)
    assert all(found.values())
    assert "over_speed" in hapticd("help").out


def test_a_wrong_name_is_told_what_was_meant(hapticd: Run) -> None:
    refused = hapticd("help", "overspeed")
    assert refused.code == 2
    assert "overspeed is no fault; did you mean over_speed?" in refused.err
    assert "Usage: hapticd status" in hapticd("help", "status").out


def test_installed_pages_are_found_where_the_installer_put_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Data files go to a prefix that only the record of the installation knows."""
    page = tmp_path / "share/doc/hapticd/faults/over_speed.md"
    page.parent.mkdir(parents=True)
    page.write_text("# over_speed\n")

    class Entry(PackagePath):
        def locate(self) -> Path:
            return tmp_path / Path(*self.parts[3:])

    monkeypatch.setattr(fault_pages, "CHECKOUT", tmp_path / "nothing")
    monkeypatch.setattr(
        fault_pages,
        "files",
        lambda name: [Entry("../../../share/doc/hapticd/faults/over_speed.md"), Entry("hapticd/jit.py")],
    )
    assert fault_pages.fault_page("over_speed") == "# over_speed\n"
    assert fault_pages.fault_page("../over_speed") is None


@pytest.mark.parametrize("words", ["release", "record start"])
def test_help_about_a_command_is_its_help(hapticd: Run, words: str) -> None:
    outcome = hapticd("help", words)
    assert outcome.code == 0
    assert f"Usage: hapticd {words}" in outcome.out
