"""A disk without room: the error names the file, and what was there before still is."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from hapticd.figures.files import naming

from .conftest import Run


@pytest.fixture
def no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    def savefig(self: Figure, path: Path, **options: Any) -> None:
        Path(path).write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", savefig)


@pytest.mark.usefixtures("no_room")
def test_a_figure_that_does_not_fit_is_named(hapticd: Run, tmp_path: Path) -> None:
    out = tmp_path / "plane.png"
    out.write_bytes(b"an older picture")
    outcome = hapticd("check", "-o", str(out), "--force")
    assert (outcome.code, outcome.err) == (2, f"hapticd: {out}: No space left on device\n")
    assert list(tmp_path.iterdir()) == [out]
    assert out.read_bytes() == b"an older picture"


def test_a_scratch_file_is_not_what_is_named(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space left") as found, naming(tmp_path):
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / ".scratch"))
    assert found.value.filename == str(tmp_path)
