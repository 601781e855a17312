from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from record_samples import CONFIG, make_rows

from hapticd.record import ROW, RecordingError, RunWriter, read_run, writer
from hapticd.record.errors import RunExistsError
from hapticd.record.schema import COLUMNS, empty_rows


def write_run(path: Path, rows: np.ndarray[Any, Any], **metadata: Any) -> Path:
    with RunWriter(path, {"config": CONFIG, **metadata}) as run:
        run.write(rows)
    return path


def test_rows_come_back_bit_for_bit(tmp_path: Path) -> None:
    rows = make_rows(1000)
    rows["current_measured_A"][::3] = -0.0
    run = read_run(write_run(tmp_path / "a.arrow", rows))
    assert list(run.columns) == list(ROW.names or ())
    for name, values in run.columns.items():
        assert values.dtype == ROW[name]
        assert values.tobytes() == np.ascontiguousarray(rows[name]).tobytes(), name
    assert not run.truncated
    assert run.warnings == ()


@pytest.mark.parametrize("counts", [[0], [1], [16383, 1, 1], [16384], [50_000], [10, 40_000, 10]])
def test_order_survives_any_sizes_of_writes(tmp_path: Path, counts: list[int]) -> None:
    first = 0
    with RunWriter(tmp_path / "a.arrow", {}) as run:
        for count in counts:
            run.write(make_rows(count, first))
            first += count
        assert run.rows == first
    assert np.array_equal(read_run(run.path).columns["tick"], np.arange(first))


def test_strided_rows_and_reused_buffers_are_copied(tmp_path: Path) -> None:
    rows = make_rows(100)
    with RunWriter(tmp_path / "a.arrow", {}) as run:
        run.write(rows[::2])
        rows["tick"] = -1
    assert np.array_equal(read_run(run.path).columns["tick"], np.arange(0, 100, 2))


def test_schema_documents_every_column_and_the_run(tmp_path: Path) -> None:
    path = write_run(tmp_path / "a.arrow", make_rows(3), config_digest="abc")
    schema = pa.ipc.open_stream(path.read_bytes()).schema
    for column in COLUMNS:
        stored = schema.field(column.name).metadata
        assert stored[b"unit"].decode() == column.unit
        assert stored[b"description"].decode() == column.description
    assert json.loads(schema.metadata[b"hapticd.config"]) == CONFIG
    assert json.loads(schema.metadata[b"hapticd.model"]) == {"plant": CONFIG["plant"], "encoder": CONFIG["encoder"]}
    assert json.loads(schema.metadata[b"hapticd.config_digest"]) == "abc"
    assert {b"hapticd.versions", b"hapticd.host", b"hapticd.created_utc"} <= set(schema.metadata)


def test_forces_of_a_linear_device_are_newtons(tmp_path: Path) -> None:
    linear = {"encoder": {"counts_per_metre": 1e5}}
    assert read_run(write_run(tmp_path / "a.arrow", make_rows(1))).units["force_command"] == "N m"
    with RunWriter(tmp_path / "b.arrow", {"config": linear}) as run:
        run.write(make_rows(1))
    assert read_run(run.path).units["force_command"] == "N"


def test_events_are_kept_with_their_row(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "a.arrow", {}) as run:
        run.write(make_rows(5))
        run.annotate({"event": "set", "changes": {"servo.rate_hz": 500.0, "limit": float("inf")}})
        run.write(make_rows(5, 5))
        run.annotate({"event": "end"})
    result = read_run(run.path)
    assert result.events == [
        {"row": 5, "event": "set", "changes": {"servo.rate_hz": 500.0, "limit": "inf"}},
        {"row": 10, "event": "end"},
    ]
    assert result.rows == 10


def test_a_batch_is_on_disk_when_its_time_has_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(writer.time, "monotonic", lambda: now)
    run = RunWriter(tmp_path / "a.arrow", {})
    run.write(make_rows(7))
    assert read_run(run.path).rows == 0
    now += 1.01 * writer.FLUSH_S
    run.write(empty_rows())
    assert read_run(run.path).rows == 7
    assert read_run(run.path).truncated
    assert writer.FLUSH_S <= 0.2
    run.close()


def test_a_file_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.arrow"
    path.write_text("mine")
    with pytest.raises(RunExistsError, match=r"a\.arrow exists: a recording never overwrites"):
        RunWriter(path, {})
    assert path.read_text() == "mine"


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"cannot create .*/no/a\.arrow: No such file or directory"):
        RunWriter(tmp_path / "no" / "a.arrow", {})


def test_an_exception_keeps_the_rows_and_marks_the_run_as_cut(tmp_path: Path) -> None:
    def fail_inside() -> None:
        with RunWriter(tmp_path / "a.arrow", {}) as run:
            run.write(make_rows(10))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_inside()
    result = read_run(tmp_path / "a.arrow")
    assert (result.rows, result.truncated) == (10, True)


def test_wrong_rows_and_a_closed_file_are_refused(tmp_path: Path) -> None:
    run = RunWriter(tmp_path / "a.arrow", {})
    with pytest.raises(TypeError, match="one-dimensional array of"):
        run.write(np.zeros(3))
    with pytest.raises(TypeError, match="shape"):
        run.write(np.zeros((3, 1), ROW))
    run.close()
    run.close()
    with pytest.raises(RecordingError, match="is closed"):
        run.write(make_rows(1))


def test_nothing_is_left_of_a_file_whose_schema_did_not_fit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int, data: memoryview) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writer.os, "write", full)
    with pytest.raises(RecordingError, match="the disk is full"):
        RunWriter(tmp_path / "a.arrow", {})
    assert list(tmp_path.iterdir()) == []


def test_a_torn_batch_is_cut_off_and_the_writer_stays_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = RunWriter(tmp_path / "a.arrow", {})
    run.write(make_rows(20))
    run.flush()
    whole = run.path.stat().st_size
    real_write = writer.os.write
    calls: list[int] = []

    def half_then_full(descriptor: int, data: memoryview) -> int:
        calls.append(len(data))
        if len(calls) > 1:
            raise OSError(28, "No space left on device")
        return real_write(descriptor, data[: len(data) // 2])

    monkeypatch.setattr(writer.os, "write", half_then_full)
    run.write(make_rows(20, 20))
    with pytest.raises(RecordingError, match=r"the disk is full \(No space left on device\); 20 rows are kept in"):
        run.flush()
    assert len(calls) == 2
    assert run.path.stat().st_size == whole
    with pytest.raises(RecordingError, match="the disk is full"):
        run.write(make_rows(1))
    run.close()
    result = read_run(run.path)
    assert (result.rows, result.truncated) == (20, True)
