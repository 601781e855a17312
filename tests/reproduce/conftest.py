"""One quick reproduction for all tests to look at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from hapticd.reproduce.build import reproduce


@dataclass(frozen=True)
class Made:
    """A folder that `reproduce` filled, what it returned, and the progress it reported."""

    folder: Path
    document: dict[str, Any]
    progress: list[float]

    def numbers(self, name: str) -> Any:
        return self.document["items"][name]["numbers"]

    def compared(self, name: str) -> dict[str, dict[str, Any]]:
        return {row["what"]: row for row in self.document["items"][name]["comparisons"]}


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("reproduce") / "paper"
    progress: list[float] = []
    return Made(folder, reproduce(folder, quick=True, progress=progress.append), progress)
