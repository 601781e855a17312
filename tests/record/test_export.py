from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from record_samples import CONFIG, make_rows
from scipy.io import loadmat

from hapticd.record import Run, RunFileError, RunWriter, export, read_run


@pytest.fixture
def run(tmp_path: Path) -> Run:
    rows = make_rows(300)
    rows["current_measured_A"][5] = np.inf
    rows["time_s"][1] = np.nextafter(rows["time_s"][1], 1.0)
    metadata: dict[str, Any] = {
        "config": {**CONFIG, "limits": [1, None, {"2nd": True}]},
        "label": 'ä "quoted", #x\nline',
    }
    with RunWriter(tmp_path / "run.arrow", metadata) as writer:
        writer.write(rows[:100])
        writer.annotate({"event": "set", "changes": {"servo.rate_hz": 500.0}})
        writer.write(rows[100:])
    return read_run(writer.path)


@pytest.mark.parametrize("to", ["csv", "parquet"])
@pytest.mark.parametrize("truncated", [False, True])
def test_csv_and_parquet_come_back_exactly(run: Run, to: str, truncated: bool) -> None:
    run = Run(run.path, run.columns, run.metadata, run.units, run.events, truncated)
    out = export(run, to)
    assert out == run.path.with_suffix(f".{to}")
    back = read_run(out)
    assert list(back.columns) == list(run.columns)
    for name, values in run.columns.items():
        assert back.columns[name].dtype == values.dtype
        np.testing.assert_array_equal(back.columns[name], values, err_msg=name)
    assert (back.metadata, back.units, back.events) == (run.metadata, run.units, run.events)
    assert back.truncated is truncated


@pytest.mark.parametrize("rows", [300, 100_000])
def test_csv_is_read_by_pandas_without_a_hint(tmp_path: Path, rows: int) -> None:
    """Without a warning, too: those are errors here, and pandas reads a long file in parts."""
    with RunWriter(tmp_path / "run.arrow", {"config": CONFIG}) as writer:
        writer.write(make_rows(rows))
    run = read_run(writer.path)
    table = pd.read_csv(export(run, "csv"))
    assert list(table.columns) == [*run.columns, "hapticd"]
    for name, values in run.columns.items():
        np.testing.assert_array_equal(table[name], values, err_msg=name)
    assert json.loads(table.hapticd[0])["config"] == CONFIG


def test_csv_of_before_with_comment_lines_is_read(run: Run, tmp_path: Path) -> None:
    rows = export(run, "csv").read_text(encoding="utf-8").splitlines()
    old = tmp_path / "old.csv"
    columns = [",".join(line.split(",")[: len(run.columns)]) for line in rows]
    old.write_text("\n".join(['# hapticd config: {"servo": {"rate_hz": 500.0}}', *columns]), encoding="utf-8")
    back = read_run(old)
    assert back.metadata["config"] == {"servo": {"rate_hz": 500.0}}
    np.testing.assert_array_equal(back.columns["time_s"], run.columns["time_s"])


def test_parquet_shows_units_and_config_to_any_reader(run: Run) -> None:
    schema = pq.read_schema(export(run, "parquet"))
    assert schema.field("force_command").metadata[b"unit"] == b"N m"
    assert json.loads(schema.metadata[b"hapticd.config"])["servo"] == {"rate_hz": 1000.0}


def test_mat_holds_columns_and_a_struct_of_metadata(run: Run) -> None:
    contents = loadmat(export(run, "mat"), simplify_cells=True)
    for name, values in run.columns.items():
        assert contents[name].dtype == values.dtype
        np.testing.assert_array_equal(contents[name], values, err_msg=name)
    described = contents["hapticd"]
    assert described["config"]["servo"]["rate_hz"] == 1000.0
    assert described["units"]["force_command"] == "N m"
    assert described["config"]["limits"][2].x2nd == 1
    expected = {**run.metadata, "units": run.units, "events": run.events, "truncated": False}
    assert json.loads(described["json"]) == expected
    assert loadmat(run.path.with_suffix(".mat"))["time_s"].shape == (300, 1)


def test_mat_names_are_legal_and_different(tmp_path: Path) -> None:
    ones = np.ones(3)
    names = ["time_s", "a b", "a-b", "_hidden", "2nd", "µ", "hapticd", "x" * 80, "x" * 80 + "y"]
    out = export(Run(tmp_path / "r.csv", {name: index * ones for index, name in enumerate(names)}), "mat")
    contents = {name: values for name, values in loadmat(out).items() if not name.startswith("__")}
    assert len(contents) == len(names) + 1
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name) for name in contents)
    values = sorted(float(column[0, 0]) for name, column in contents.items() if name != "hapticd")
    assert values == [float(index) for index in range(len(names))]


def test_a_run_without_rows_can_be_exported(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "none.arrow", {}):
        pass
    for to in ("csv", "parquet", "mat"):
        out = export(read_run(tmp_path / "none.arrow"), to)
        assert out.stat().st_size > 0
    assert read_run(tmp_path / "none.csv").rows == 0
    assert read_run(tmp_path / "none.parquet").rows == 0


def test_a_file_is_replaced_only_when_forced(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "mine.csv"
    out.write_text("mine")
    with pytest.raises(FileExistsError, match=r"mine\.csv exists; give another name, or --force to replace it"):
        export(run, "csv", out)
    assert out.read_text() == "mine"
    assert export(run, "csv", out, force=True) == out
    assert read_run(out).rows == 300


def test_a_failed_export_leaves_what_was_there_and_no_part(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    out = folder / "mine.mat"
    out.write_text("mine")

    def full(stream: Any, *_: Any, **__: Any) -> None:
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("scipy.io.savemat", full)
    with pytest.raises(RunFileError, match=r"cannot write .*mine\.mat: No space left on device"):
        export(run, "mat", out, force=True)
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("mine.mat", "mine")]


def test_bad_requests_are_named(run: Run, tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="cannot export to 'xls': the formats are csv, parquet, mat"):
        export(run, "xls")
    with pytest.raises(RunFileError, match="is a folder; give a file name"):
        export(run, "csv", tmp_path)
    with pytest.raises(RunFileError, match=r"cannot write .*/no/a\.csv: No such file or directory"):
        export(run, "csv", tmp_path / "no" / "a.csv")
