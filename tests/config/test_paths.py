"""A user's folder in a place where everybody may write: who made it first decides nothing."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hapticd.config import paths
from hapticd.record import RecordingError
from hapticd.record.flight import FlightRing
from hapticd.service.socket import SocketError, bind


@pytest.fixture
def open_to_all(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Stands for /tmp and /dev/shm."""
    monkeypatch.setattr("hapticd.config.paths.TEMPORARY", tmp_path)
    monkeypatch.setattr("hapticd.config.paths.SHARED_MEMORY", tmp_path)
    return tmp_path


def test_a_folder_of_ours_is_used(open_to_all: Path) -> None:
    own = open_to_all / f"hapticd-{os.getuid()}"
    assert paths.foreign(own) is None, "not there yet"
    own.mkdir(mode=0o755)
    assert paths.foreign(own) is None
    assert paths.memory_folder() == own


def test_a_folder_that_somebody_else_made_first_is_not_used(open_to_all: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = os.getuid() + 1
    with monkeypatch.context() as patch:
        patch.setattr(os, "getuid", lambda: stranger)
        theirs = open_to_all / f"hapticd-{stranger}"
        theirs.mkdir()
        assert f"{theirs} belongs to uid {stranger - 1}, not to uid {stranger}" in str(paths.foreign(theirs))
        with pytest.raises(SocketError, match="belongs to uid"):
            bind(theirs / "hapticd.sock")
        with pytest.raises(RecordingError, match="belongs to uid"):
            FlightRing.create(theirs, "rig", 1024)
        assert list(theirs.iterdir()) == []
    elsewhere = open_to_all / "elsewhere"
    elsewhere.mkdir(mode=0o755)
    own = open_to_all / f"hapticd-{os.getuid()}"
    own.symlink_to(elsewhere)
    assert "is not a directory" in str(paths.foreign(own))
    own.unlink()
    own.mkdir()
    own.chmod(0o777)
    assert "others may write to" in str(paths.foreign(own))
    assert paths.foreign(elsewhere) is None, "a folder that the config names is its owner's affair"
