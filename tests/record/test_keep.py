"""Which run files ``record.keep`` removes, and which never."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hapticd.record.files import remove_oldest

NOW = 1_800_000_000.0
DAY_S = 86400.0


def make(folder: Path, name: str, age_s: float, size: int = 100) -> Path:
    path = folder / name
    path.write_bytes(bytes(size))
    os.utime(path, (NOW - age_s, NOW - age_s))
    return path


def run_name(number: int, kind: str = "run", label: str = "") -> str:
    return f"{kind}-20260101T0000{number:02d}.000Z{label}.arrow"


def test_the_oldest_go_first_until_the_rest_fits(tmp_path: Path) -> None:
    paths = [make(tmp_path, run_name(number, label="-release-2"), 10_000 - number) for number in range(5)]
    kept = remove_oldest(tmp_path, 250, None, NOW)
    assert kept.removed == paths[:3]
    assert kept.size == 200
    assert sorted(tmp_path.iterdir()) == paths[3:]
    assert remove_oldest(tmp_path, 250, None, NOW).removed == []


def test_what_is_recorded_or_was_written_just_now_stays(tmp_path: Path) -> None:
    recording = make(tmp_path, run_name(1), 5000)
    other = make(tmp_path, run_name(2), 30)
    kept = remove_oldest(tmp_path, 1, recording, NOW)
    assert (kept.removed, kept.size) == ([], 200)
    assert sorted(tmp_path.iterdir()) == [recording, other]


@pytest.mark.parametrize("kind", ["fault", "crash"])
def test_what_a_fault_left_stays_for_a_day(kind: str, tmp_path: Path) -> None:
    young, old = make(tmp_path, run_name(1, kind), DAY_S - 60), make(tmp_path, run_name(2, kind), DAY_S + 60)
    assert remove_oldest(tmp_path, 1, None, NOW).removed == [old]
    assert list(tmp_path.iterdir()) == [young]


@pytest.mark.parametrize(
    "name", ["precious.arrow", "run-1.arrow", run_name(1) + ".bak", "my-" + run_name(1), run_name(1, "scope")]
)
def test_what_is_not_named_by_us_is_neither_counted_nor_removed(name: str, tmp_path: Path) -> None:
    make(tmp_path, name, 5 * DAY_S)
    kept = remove_oldest(tmp_path, 1, None, NOW)
    assert (kept.removed, kept.size) == ([], 0)
    assert (tmp_path / name).exists()


def test_links_and_folders_below_are_left(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    target = make(tmp_path / "kept", run_name(1), 5 * DAY_S)
    (tmp_path / run_name(2)).symlink_to(target)
    (tmp_path / run_name(3)).mkdir()
    assert remove_oldest(tmp_path, 1, None, NOW).removed == []
    assert target.exists()


def test_a_folder_that_is_not_there_holds_nothing(tmp_path: Path) -> None:
    assert remove_oldest(tmp_path / "none", 1, None, NOW).size == 0
