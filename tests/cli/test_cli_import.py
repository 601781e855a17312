"""``hapticd import``, and what reads its runs."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from .conftest import Run

MAP = """
device: rotary
time: {column: t, unit: ms}
position: {column: counts, unit: count}
current: {column: amps}
encoder: {counts_per_rev: 8192}
"""


@pytest.fixture
def measured(tmp_path: Path) -> Path:
    time = np.arange(3000.0)
    counts = np.floor(500 * np.sin(0.005 * time))
    table = np.stack([time, counts, np.cos(0.005 * time)], axis=1)
    np.savetxt(tmp_path / "lab.csv", table, delimiter=",", header="t,counts,amps", comments="")
    (tmp_path / "map.yaml").write_text(MAP)
    return tmp_path


def test_import_then_export_and_energy(hapticd: Run, measured: Path) -> None:
    run = measured / "lab.arrow"
    done = hapticd("import", str(measured / "lab.csv"), "--map", str(measured / "map.yaml"), "-o", str(run), "--json")
    assert done.code == 0
    assert done.document["rows"] == 3000
    assert done.document["duration_s"] == pytest.approx(2.999)
    assert done.document["resolution"] == pytest.approx(2 * np.pi / 8192)
    assert hapticd("export", str(run), "--to", "parquet").code == 0
    energy = hapticd("energy", str(run), "--config", "re35", "--json")
    assert energy.code == 0
    assert energy.document["rows"] == 3000


def test_a_wrong_map_is_a_usage_error(hapticd: Run, measured: Path) -> None:
    (measured / "map.yaml").write_text(MAP.replace("column: amps", "column: amp"))
    run = measured / "lab.arrow"
    done = hapticd("import", str(measured / "lab.csv"), "--map", str(measured / "map.yaml"), "-o", str(run))
    assert done.code == 2
    assert "current.column = amp: no such column; did you mean amps?" in done.err
    assert not run.exists()


@pytest.mark.parametrize(
    ("out", "said"),
    [
        ("x.csv", "x.csv: a run file is an Arrow stream; write {}/x.arrow, then 'hapticd export {}/x.arrow --to csv'"),
        ("x.MCAP", "write {}/x.arrow, then 'hapticd export {}/x.arrow --to mcap'"),
        ("lab.csv", "lab.csv: a run file is an Arrow stream; write {}/lab.arrow"),
        ("map.yaml", "map.yaml: a run file is an Arrow stream; write {}/map.arrow\n"),
        ("no/x.arrow", "x.arrow: there is no folder {}/no\n"),
        ("lab.csv/x.arrow", "x.arrow: there is no folder {}/lab.csv\n"),
        (".", "{} is a folder; give a file name"),
    ],
)
def test_where_no_run_belongs_none_is_written(hapticd: Run, measured: Path, out: str, said: str) -> None:
    before = {path: path.read_bytes() for path in measured.iterdir()}
    words = ("--map", str(measured / "map.yaml"), "-o", str(measured / out), "--force")
    done = hapticd("import", str(measured / "lab.csv"), *words)
    assert (done.code, done.out) == (2, "")
    assert said.replace("{}", str(measured)) in done.err
    assert ".part" not in done.err
    assert {path: path.read_bytes() for path in measured.iterdir()} == before


def test_a_folder_that_cannot_be_written_to_is_named(
    hapticd: Run, measured: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = measured / "lab.arrow"
    access = os.access
    monkeypatch.setattr("os.access", lambda path, mode, **more: path != measured and access(path, mode, **more))
    done = hapticd("import", str(measured / "lab.csv"), "--map", str(measured / "map.yaml"), "-o", str(run))
    assert (done.code, done.err) == (2, f"hapticd: {run}: this user cannot write to {measured}\n")


@pytest.mark.parametrize("name", ["run", "k0.5", "RUN.ARROW"])
def test_a_name_that_tells_no_other_format_is_taken(hapticd: Run, measured: Path, name: str) -> None:
    run = measured / name
    assert hapticd("import", str(measured / "lab.csv"), "--map", str(measured / "map.yaml"), "-o", str(run)).code == 0
    assert hapticd("export", str(run), "--to", "parquet", "-o", str(measured / "again.parquet")).code == 0


def test_a_run_that_exists_is_kept(hapticd: Run, measured: Path) -> None:
    words = ("import", str(measured / "lab.csv"), "--map", str(measured / "map.yaml"), "-o", str(measured / "r.arrow"))
    assert hapticd(*words).code == 0
    refused = hapticd(*words)
    assert refused.code == 2
    assert "--force" in refused.err
    assert hapticd(*words, "--force").code == 0
