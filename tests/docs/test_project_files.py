"""License, citation and changelog agree with pyproject.toml; decision records are listed, few, and say status and date."""

from __future__ import annotations

import re
import tomllib

import pytest
import yaml

from .snippets import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_the_license_is_the_declared_one() -> None:
    assert (PROJECT["license"], PROJECT["license-files"]) == ("BSD-3-Clause", ["LICENSE"])
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert text.startswith("BSD 3-Clause License\n\nCopyright (c) 2026, the hapticd authors\n")
    assert text.count("Neither the name of the copyright holder") == 1


def test_the_citation_is_of_this_version_and_of_the_paper() -> None:
    assert {"cff-version", "message", "title", "authors"} <= CITATION.keys()
    assert (CITATION["version"], CITATION["license"]) == (PROJECT["version"], PROJECT["license"])
    assert CITATION["authors"] == PROJECT["authors"]
    (paper,) = CITATION["references"]
    assert [author["family-names"] for author in paper["authors"]] == ["Diolaiti", "Niemeyer", "Barbagli", "Salisbury"]
    assert paper["title"].startswith("Stability of Haptic Rendering")


def test_the_changelog_knows_this_version() -> None:
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert PROJECT["version"] in [heading.partition(":")[0] for heading in headings]


@pytest.mark.parametrize("name", ["CHANGELOG.md", "CONTRIBUTING.md"])
def test_links_lead_somewhere(name: str) -> None:
    links = re.findall(r"\]\(([^)#]+)", (ROOT / name).read_text(encoding="utf-8"))
    assert links
    assert [link for link in links if not (ROOT / link).is_file()] == []


def test_decision_records_are_few_listed_and_say_status_and_date() -> None:
    folder = ROOT / "docs" / "decisions"
    listed = re.findall(r"\]\((0[^)]+)\)", (folder / "README.md").read_text(encoding="utf-8"))
    records = sorted(path.name for path in folder.glob("0*.md"))
    assert listed == records
    assert len(records) <= 30
    for name in records:
        head = (folder / name).read_text(encoding="utf-8").split("\n\n")
        assert re.match(rf"# {int(name[:4])}\. \S", head[0]), name
        assert re.match(r"\*\*Status\.\*\* .*\*\*Date\.\*\* \d{4}-\d\d-\d\d", head[1], re.S), name


def test_the_readme_begins_with_the_two_commands_and_the_changelog_is_short() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.match(r"# hapticd\n\n```sh\nmake run .*\nmake test .*\n```\n", readme)
    assert len(readme.splitlines()) <= 40
    assert len((ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()) <= 25
