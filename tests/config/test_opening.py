"""Paths that are no files: nothing hangs, nothing is read without end, and the message says what it is."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hapticd.config import ConfigError, load_config
from hapticd.config.opening import open_regular
from hapticd.record import RunFileError, import_run, parse_map, read_run

MAP = {
    "device": "rotary",
    "time": {"column": "t", "unit": "s"},
    "position": {"column": "x", "unit": "rad"},
    "current": {"column": "i", "unit": "A"},
}
PATHS = {"pipe": "a pipe", "socket": "a socket", "zero": "a device", "folder": "a folder", "link": "a pipe"}


@pytest.fixture
def places(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "link.csv").symlink_to(tmp_path / "pipe.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    (tmp_path / "folder.csv").mkdir()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket.csv"))
    return tmp_path


@pytest.mark.timeout(30)
@pytest.mark.parametrize("kind", PATHS)
def test_what_is_no_file_is_refused_at_once(places: Path, kind: str) -> None:
    path = places / f"{kind}.csv"
    with pytest.raises(ConfigError):
        load_config(path)
    mapping = parse_map(MAP, "map")
    readers: tuple[Callable[[Path], Any], ...] = (
        read_run,
        lambda path: import_run(path, mapping, places / "out.arrow"),
    )
    for reader in readers:
        with pytest.raises(RunFileError, match=f"cannot read .*{kind}"):
            reader(path)


def test_a_file_and_a_link_to_one_are_opened(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"here")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    for name in ("file", "link"):
        with open_regular(tmp_path / name) as file:
            assert file.read() == b"here"


def test_the_kind_is_said(places: Path) -> None:
    for kind, words in PATHS.items():
        if kind != "socket":  # the kernel refuses to open one, in its own words
            with pytest.raises(OSError, match=words):
                open_regular(places / f"{kind}.csv")
