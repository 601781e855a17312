from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from record_samples import make_rows

from hapticd.record import RunFileError, RunWriter, read_run
from hapticd.record.stream import METADATA_CHECK, metadata_checksum


@pytest.fixture
def native(tmp_path: Path) -> Path:
    with RunWriter(tmp_path / "run.arrow", {}) as run:
        for first in range(0, 100, 20):
            run.write(make_rows(20, first))
            run.flush()
    return run.path


def test_a_tail_cut_at_any_byte_costs_at_most_the_batch_it_is_in(native: Path) -> None:
    data = native.read_bytes()
    cut = native.with_name("cut.arrow")
    sizes: list[int] = []
    for size in range(len(data) - 1, 0, -7):
        cut.write_bytes(data[:size])
        try:
            run = read_run(cut)
        except RunFileError as error:
            assert "is not a run file" in str(error)  # noqa: PT017
            continue
        assert run.truncated
        assert "was not ended properly" in run.warnings[0]
        assert np.array_equal(run.columns["tick"], np.arange(run.rows))
        sizes.append(run.rows)
    assert set(sizes) == {0, 20, 40, 60, 80, 100}
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize("tail", [b"\0" * 4096, b"\0" * 3, b"\xff" * 64, b"garbage that is no message"])
def test_rubbish_after_the_last_batch_is_left_out(native: Path, tail: bytes) -> None:
    native.write_bytes(native.read_bytes()[:-8] + tail)
    run = read_run(native)
    assert (run.rows, run.truncated) == (100, True)


@settings(deadline=None)
@given(data=st.data())
def test_damage_anywhere_ends_in_rows_or_in_a_clear_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
):
    folder = tmp_path_factory.getbasetemp()
    path = folder / "damaged.arrow"
    path.unlink(missing_ok=True)
    with RunWriter(path, {}) as run:
        run.write(make_rows(20))
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(raw)
    try:
        rows = read_run(path).rows
    except RunFileError as error:
        assert str(path) in str(error)  # noqa: PT017
    else:
        assert 0 <= rows <= 20


def test_a_first_message_that_is_no_schema_is_not_taken_for_one(native: Path) -> None:
    raw = native.read_bytes()
    size = 8 + int.from_bytes(raw[4:8], "little")
    native.write_bytes(raw[size:])
    with pytest.raises(RunFileError, match="begins with a message of type 'record batch'"):
        read_run(native)


def test_a_file_being_written_can_be_read(tmp_path: Path) -> None:
    run = RunWriter(tmp_path / "a.arrow", {})
    run.write(make_rows(5))
    run.flush()
    assert read_run(run.path).rows == 5
    run.close()


def test_a_newer_format_is_refused_with_what_to_do(native: Path, tmp_path: Path) -> None:
    table = pa.ipc.open_stream(native.read_bytes()).read_all()
    schema = table.schema.with_metadata({**table.schema.metadata, b"hapticd.format_version": b"3"})
    schema = schema.with_metadata({**schema.metadata, METADATA_CHECK: metadata_checksum(schema)})
    with pa.OSFile(str(tmp_path / "newer.arrow"), "wb") as sink, pa.ipc.new_stream(sink, schema) as stream:
        stream.write_table(table.cast(schema))
    with pytest.raises(RunFileError, match=r"newer.arrow is a run file of format 3, and .* up to 2: install"):
        read_run(tmp_path / "newer.arrow")


def test_files_that_are_no_runs_are_named_with_the_reason(tmp_path: Path) -> None:
    cases = {
        "missing.arrow": (None, "cannot read .*missing.arrow: No such file or directory"),
        "empty.arrow": (b"", "empty.arrow is empty: its recording ended before anything was written"),
        "empty.csv": (b"", "empty.csv is empty"),
        "text.arrow": (b"hello, this is a letter to my aunt\n" * 9, "text.arrow is not a run file"),
        "short.arrow": (b"\xff", "short.arrow is not a run file"),
        "text.parquet": (b"PAR1 and nothing else", "text.parquet is not a Parquet file"),
        "latin1.csv": (
            '"Zeit [ms]";"Winkel (°)"\n0;1\n'.encode("latin1"),
            r"latin1.csv is not UTF-8 \(Latin-1\?\); 'iconv -f latin1 -t utf-8 latin1.csv > utf8.csv' converts it",
        ),
        "utf16.csv": ("time_s,position,force\n0,1,2\n".encode("utf-16"), r"utf16.csv is not UTF-8 \(UTF-16\?\); "),
        "commas.csv": (
            b"# scope\ntime_s;position;force\n0,0;0;-2,55\n",
            r"Expected 1 columns, got 3: .*; its values are separated by ';': 'hapticd import' reads it with csv: {del",
        ),
        "title.csv": (b"a scope's export\nt,q,i\n0,1,2\n", "Expected 1 columns, got 3: t,q,i$"),
        "ragged.csv": (b"time_s,position\n1,2\n3\n", "ragged.csv is not a readable CSV file"),
    }
    for name, (content, message) in cases.items():
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(RunFileError, match=message):
            read_run(tmp_path / name)
    with pytest.raises(RunFileError, match="it is a folder, not a file"):
        read_run(tmp_path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission_is_named(native: Path) -> None:
    native.chmod(0)
    with pytest.raises(RunFileError, match="Permission denied"):
        read_run(native)


def test_missing_columns_are_named_beside_those_that_are_there(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time_s,speed\n0,1\n")
    with pytest.raises(RunFileError) as caught:
        read_run(path)
    assert str(caught.value) == (
        f"{path} lacks the column(s) encoder_counts or position; current_command_A or force (it has: time_s, speed); "
        "'hapticd import' brings in files with other names, units and formats"
    )
    parquet = tmp_path / "a.parquet"
    pq.write_table(pa.table({"position": [1.0], "force": [2.0]}), parquet)
    with pytest.raises(RunFileError, match=r"lacks the column\(s\) time_s \(it has: position, force\)"):
        read_run(parquet)
    arrow = tmp_path / "a.arrow"
    with pa.OSFile(str(arrow), "wb") as sink, pa.ipc.new_stream(sink, pa.schema([("x", pa.int64())])):
        pass
    with pytest.raises(RunFileError, match=r"lacks the column\(s\) time_s; encoder_counts or position"):
        read_run(arrow)


def test_a_csv_from_elsewhere_is_read_in_our_types(tmp_path: Path) -> None:
    path = tmp_path / "lab.csv"
    path.write_bytes(
        b"\xef\xbb\xbf# measured by hand\r\ntime_s, encoder_counts,force,note\r\n0,-3.0,1,a\r\n0.001,4.0,,b\r\n"
    )
    run = read_run(path)
    assert run.columns["encoder_counts"].dtype == np.int64
    assert run.columns["encoder_counts"].tolist() == [-3, 4]
    assert run.columns["force"].dtype == np.float64
    assert np.isnan(run.columns["force"][1])
    assert run.columns["note"].tolist() == ["a", "b"]
    assert run.metadata == {}
    assert not run.truncated


def test_a_column_of_the_wrong_kind_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time_s,encoder_counts,force\n0,1.5,1\n")
    with pytest.raises(RunFileError, match="column encoder_counts must hold whole numbers, none missing"):
        read_run(path)
    path.write_text("time_s,encoder_counts,force\n0,many,1\n")
    with pytest.raises(RunFileError, match="column encoder_counts holds string, not numbers"):
        read_run(path)
    path.write_text("time_s,encoder_counts,force\n0,1,strong\n")
    with pytest.raises(RunFileError, match=r"not a readable CSV file: .*strong"):
        read_run(path)
    path.write_text("time_s,position,position,force\n0,1,2,3\n")
    with pytest.raises(RunFileError, match="more than one column position"):
        read_run(path)


def test_time_that_does_not_rise_is_reported_and_read(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time_s,position,force\n0,1,1\n2,1,1\n1,1,1\n1,1,1\n")
    run = read_run(path)
    assert run.rows == 4
    assert run.warnings == ("time_s does not rise at 2 place(s), first at row 2",)
    path.write_text("time_s,position,force\n0,1,1\nnan,1,1\n")
    assert read_run(path).warnings == ("time_s holds values that are not finite",)


def test_a_step_of_the_clock_is_told_from_lost_rows(tmp_path: Path) -> None:
    time_s = 0.001 * np.arange(2000)
    moving = np.rint(2000 * np.sin(20 * time_s)).astype(int)
    stepped = time_s + 0.005 * (np.arange(2000) >= 1000)

    def read(stamps: Any, counts: Any) -> tuple[str, ...]:
        path = tmp_path / "run.csv"
        table = np.stack([stamps, counts, 0 * stamps], 1)
        header = "time_s,encoder_counts,current_command_A"
        np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
        return read_run(path).warnings

    (warning,) = read(stepped, moving)
    assert warning == "the clock steps by +5 ms at row 1000: the motion goes on as in one period"
    lost = np.r_[0:1000, 1005:2000]
    assert read(time_s[lost], moving[lost]) == ()
    assert read(stepped, 0 * moving) == ()  # at rest nothing tells


def test_a_run_is_shown_short_and_with_a_trace_in_a_notebook(tmp_path: Path) -> None:
    time_s = 0.001 * np.arange(50_000)
    table = np.stack([time_s, np.rint(1000 * np.sin(time_s)), 0 * time_s], 1)
    header = "time_s,encoder_counts,current_command_A"
    np.savetxt(tmp_path / "<run>.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    run = read_run(tmp_path / "<run>.csv")
    assert repr(run) == f"Run('{tmp_path}/<run>.csv': 50000 rows, 50 s at 1000 Hz, 3 columns)"
    html = run._repr_html_()
    assert len(html) < 40_000
    assert "&lt;run&gt;.csv" in html
    assert "-1000 to 1000 count over 50 s" in html
    points = html.split("points='")[1].split("'")[0].split()
    heights = [float(point.split(",")[1]) for point in points]
    assert (min(heights), max(heights)) == (4.0, 136.0)
