"""The list of recordings, and what ``@last`` stands for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from record_samples import CONFIG, make_rows

from hapticd.record import RunFileError, RunWriter, run_metadata
from hapticd.record.listing import listed, resolve_run, run_paths


def recording(path: Path, rows: int = 300, at: float = 1e9, complete: bool = True) -> Path:
    writer = RunWriter(path, {**run_metadata(CONFIG), "kind": "run", "label": "release"})
    writer.write(make_rows(rows))
    writer.close(complete=complete)
    os.utime(path, (at, at))
    return path


def test_the_newest_is_last_whatever_the_folder(tmp_path: Path) -> None:
    left, right = tmp_path / "left", tmp_path / "right"
    left.mkdir()
    right.mkdir()
    old, new = recording(left / "z.arrow", at=1e9), recording(right / "a.arrow", at=2e9)
    (left / "notes.txt").write_text("not a run")
    (left / ".part.arrow").write_bytes(b"")
    folders = [left, right, tmp_path / "nowhere"]
    assert run_paths(folders) == [new, old]
    assert resolve_run("@last", folders) == new
    assert resolve_run("@last~1", folders) == old
    assert resolve_run("z.arrow", folders) == old


def test_what_was_kept_before_a_fault_is_listed_and_is_not_last(tmp_path: Path) -> None:
    run, fault = recording(tmp_path / "run-1.arrow"), recording(tmp_path / "fault-2-over_speed.arrow", at=2e9)
    assert run_paths([tmp_path]) == [fault, run]
    assert resolve_run("@last", [tmp_path]) == run


def test_of_two_of_one_instant_the_later_name_is_the_newer(tmp_path: Path) -> None:
    first, second = recording(tmp_path / "run-1.arrow"), recording(tmp_path / "run-2.arrow")
    assert run_paths([tmp_path]) == [second, first]


@pytest.mark.parametrize(
    ("name", "said"),
    [("@last~1", "@last~1: 1 recording(s) in"), ("@newest", "the newest recording is @last"), ("@last~x", "is @last")],
)
def test_a_recording_that_is_not_there_is_named(tmp_path: Path, name: str, said: str) -> None:
    recording(tmp_path / "run.arrow")
    with pytest.raises(RunFileError) as error:
        resolve_run(name, [tmp_path])
    assert said in str(error.value)


def test_a_path_stays_a_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording(tmp_path / "run.arrow")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "@last").write_bytes(b"")
    assert resolve_run("./run.arrow", []) == Path("run.arrow")
    assert resolve_run("@last", [tmp_path]) == Path("@last")
    assert resolve_run("missing.arrow", [tmp_path]) == Path("missing.arrow")


def test_what_a_recording_says_of_itself(tmp_path: Path) -> None:
    found = listed(recording(tmp_path / "run.arrow", rows=2500))
    assert (found.kind, found.label, found.rows, found.whole, found.error) == ("run", "release", 2500, True, None)
    assert found.duration_s == pytest.approx(2.499)


def test_a_cut_recording_is_listed_with_what_it_has(tmp_path: Path) -> None:
    path = recording(tmp_path / "run.arrow", rows=3000, complete=False)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.8 * len(whole))])
    found = listed(path)
    assert found.whole is False
    assert 0 < (found.rows or 0) < 3000
    assert (found.rows or 0) % 1024 == 0


@pytest.mark.parametrize(("content", "said"), [(b"", "empty"), (b"no run at all, but long enough", "no run file")])
def test_what_is_no_run_is_listed_with_the_reason(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "x.arrow"
    path.write_bytes(content)
    assert said in (listed(path).error or "")
