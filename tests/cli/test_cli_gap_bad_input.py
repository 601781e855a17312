"""``hapticd gap`` on files from which nothing can be concluded: exit 2, what is wrong and where, and no folder is made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from .conftest import Run

Columns = dict[str, Any]
MODEL = """
encoder: {counts_per_rev: 8192}
plant: {inertia: 2.0e-5, viscous: 4.0e-5, coulomb: 1.5e-3}
amplifier: {torque_constant: 0.03, bandwidth_hz: 0, dac_bits: 0}
"""


def good() -> Columns:
    """Three seconds to and fro, with a command of the right size."""
    time = np.arange(3000) * 1e-3
    counts = np.floor(4000.0 * np.sin(3.0 * time))
    return {"time_s": time, "encoder_counts": counts, "current_command_A": 0.1 * np.sin(3.0 * time)}


def changed(name: str, change: Callable[[Any], Any]) -> Columns:
    columns = good()
    return columns | {name: change(columns[name].copy())}


def holding(row: int, value: float) -> Callable[[Any], Any]:
    def put(values: Any) -> Any:
        values[row] = value
        return values

    return put


def wrapped(counts: Any) -> Any:
    return counts.astype(np.int64) % 2**32


BAD: dict[str, tuple[Columns, str]] = {
    "too few": ({name: values[:100] for name, values in good().items()}, "100 samples are too few; at least 200"),
    "too short": ({name: values[:600] for name, values in good().items()}, "0.599 s are too short; at least 1 s"),
    "no motion": (changed("encoder_counts", lambda c: 0 * c), "there is no motion: the position changes by 0 encoder"),
    "clock backwards": (changed("time_s", holding(1000, 0.5)), "clock runs backwards or stops at 1 place(s)"),
    "hole in time": (changed("time_s", lambda t: t + 2.0 * (t > 1.5)), "more than 20 % of the record is missing"),
    "no number": (changed("current_command_A", holding(77, np.nan)), "current is missing or not finite in 1 row(s)"),
    "no count": (changed("encoder_counts", holding(77, np.nan)), "column encoder_counts must hold whole numbers"),
    "part of a count": (changed("encoder_counts", lambda c: c / 1000), "row 1 holds 0.011"),
    "ms": (changed("time_s", lambda t: 1e3 * t), "1 s between samples is 1 Hz, slower than 20 Hz; is it in ms?"),
    "mA": (
        changed("current_command_A", lambda i: 1e4 * i),
        "times amplifier.peak_current = 6 A of the model; is it in mA?",
    ),
    "kA": (changed("current_command_A", lambda i: 1e-4 * i), "more than 200: a unit is wrong by a large factor"),
    "counts × 1000": (
        changed("encoder_counts", lambda c: 1000 * c),
        "more than 200: a unit is wrong by a large factor",
    ),
    "32 bits": (
        changed("encoder_counts", wrapped),
        "a counter that overflows at 4294967296; import it with position.wrap",
    ),
    "64 bits": (changed("encoder_counts", lambda c: c + 1e19), "row 0 holds 1e+19, more than the 64 bits of a counter"),
    "no current": (
        changed("current_command_A", lambda i: 0 * i),
        "current is 0 A in every row, and yet the shaft moves",
    ),
    "no column": ({"time_s": good()["time_s"], "encoder_counts": good()["encoder_counts"]}, "lacks the column(s)"),
}


def written(path: Path, columns: Columns) -> Path:
    if path.suffix == ".parquet":
        pq.write_table(pa.table(columns), path)
    else:
        np.savetxt(path, np.column_stack(list(columns.values())), "%.17g", ",", header=",".join(columns), comments="")
    return path


@pytest.mark.parametrize("form", ["csv", "parquet"])
@pytest.mark.parametrize("name", BAD)
def test_bad_samples(hapticd: Run, tmp_path: Path, name: str, form: str) -> None:
    columns, statement = BAD[name]
    (tmp_path / "rig.yaml").write_text(MODEL)
    run = written(tmp_path / f"lab.{form}", columns)
    done = hapticd("gap", str(run), "--model", str(tmp_path / "rig.yaml"), "-o", str(tmp_path / "gap"))
    assert done.code == 2
    assert statement in done.err
    assert f"lab.{form}" in done.err
    assert "Traceback" not in done.err
    assert not (tmp_path / "gap").exists()


HEAD = "time_s;encoder_counts;current_command_A\n"
FILES: dict[str, tuple[bytes, str]] = {
    "empty.csv": (b"", "is empty"),
    "header.csv": (HEAD.replace(";", ",").encode(), "0 samples are too few"),
    "semicolons.csv": ((HEAD + "0;1;2\n" * 300).encode(), "separated by ';': 'hapticd import' reads it"),
    "commas.csv": (HEAD.encode() + b"0,0;0;-2,55\n" * 300, "separated by ';': 'hapticd import' reads it"),
    "latin1.csv": ("Winkel (°);t\n1;2\n".encode("latin1"), "'iconv -f latin1 -t utf-8 latin1.csv > utf8.csv'"),
    "tabs.csv": ((HEAD + "0;1;2\n" * 300).replace(";", "\t").encode(), r"csv: {delimiter: '\t'}"),
    "names.csv": (b"t,counts,amps\n0,1,2\n", "'hapticd import' brings in files with other names"),
    "words.csv": (HEAD.replace(";", ",").encode() + b"0,1,on\n" * 300, "invalid value 'on'"),
    "ragged.csv": (HEAD.replace(";", ",").encode() + b"0,1,2\n1,2\n", "Expected 3 columns, got 2"),
    "damaged.parquet": (b"abc" * 100, "is not a Parquet file"),
    "damaged.arrow": (b"abc" * 100, "is not a run file"),
    "lab.npy": (b"abc", "is not a run file; 'hapticd import' brings in"),
    "lab.mat": (b"abc", "is not a run file; 'hapticd import' brings in"),
}


@pytest.mark.parametrize("name", FILES)
def test_files_that_are_no_runs(hapticd: Run, tmp_path: Path, name: str) -> None:
    content, statement = FILES[name]
    (tmp_path / name).write_bytes(content)
    done = hapticd("gap", str(tmp_path / name), "--model", "re35", "-o", str(tmp_path / "gap"))
    assert done.code == 2
    assert statement in done.err
    assert not (tmp_path / "gap").exists()


def test_nothing_is_written_over_what_is_read(hapticd: Run, tmp_path: Path) -> None:
    nominal = tmp_path / "model.yaml"
    nominal.write_text(MODEL)
    run = written(tmp_path / "lab.csv", good())
    done = hapticd("gap", str(run), "--model", str(nominal), "-o", str(tmp_path))
    assert (done.code, f"{nominal} is the file that is read; give another name" in done.err) == (2, True)
    assert nominal.read_text() == MODEL


def test_a_folder_that_cannot_be_made_is_said_before_the_search(hapticd: Run, tmp_path: Path) -> None:
    run = written(tmp_path / "lab.csv", good())
    out = run / "gap"
    done = hapticd("gap", str(run), "--model", "re35", "-o", str(out))
    assert (done.code, done.err) == (2, f"hapticd: {out}: {run} is not a folder\n")


def test_no_file(hapticd: Run, tmp_path: Path) -> None:
    done = hapticd("gap", str(tmp_path / "none.csv"), "--model", "re35", "-o", str(tmp_path / "gap"))
    assert (done.code, "No such file" in done.err) == (2, True)
