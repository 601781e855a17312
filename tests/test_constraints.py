"""What `make` installs is to be had for every Python that the project allows, not only for the one that runs the tests."""

from __future__ import annotations

import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parent.parent


def test_every_pinned_package_takes_the_oldest_python() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    oldest = str(project["requires-python"]).removeprefix(">=")
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    seen, too_new = 0, []
    for name, version in (line.split("==") for line in lines if "==" in line):
        try:
            installed = metadata(name)
        except PackageNotFoundError:  # pinned for another platform, or for an extra
            continue
        if installed["Version"] != version.partition(";")[0].strip():
            continue
        asked = installed.get("Requires-Python")
        seen += 1
        if asked and not SpecifierSet(asked).contains(f"{oldest}.0"):
            too_new.append(f"{name} asks for {asked}")
    assert seen > 50
    assert not too_new
