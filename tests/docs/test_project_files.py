"""License, citation and changelog agree with pyproject.toml, and their links lead somewhere."""

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
