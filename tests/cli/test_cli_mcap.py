"""``hapticd export --to mcap`` and ``hapticd import``: there and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hapticd.config import load_config
from hapticd.record import RunWriter, read_run, run_metadata
from hapticd.record.schema import empty_rows

from .conftest import Run


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rows = empty_rows(50)
    rows["time_s"] = np.arange(50) / 1000
    rows["encoder_counts"] = np.arange(50) ** 2
    rows["flags"] = 1
    with RunWriter("run.arrow", run_metadata(load_config(None).model_dump(mode="json"))) as writer:
        writer.write(rows)
    return Path("run.arrow")


def test_there_and_back(hapticd: Run, run: Path) -> None:
    there = hapticd("export", "run.arrow", "--to", "mcap")
    assert (there.code, there.err) == (0, "")
    first, second = there.out.splitlines()
    assert first == "run.mcap: 50 rows"
    layout = Path(second.split()[2])
    assert second == f"plotjuggler --layout {layout} --datafile run.mcap"
    assert layout.is_file()
    back = hapticd("import", "run.mcap", "-o", "back.arrow", "--json").document
    assert (back["rows"], back["rate_hz"]) == (50, pytest.approx(1000.0))
    np.testing.assert_array_equal(read_run("back.arrow").columns["encoder_counts"], np.arange(50) ** 2)


def test_an_mcap_needs_no_map_and_a_table_needs_one(hapticd: Run, run: Path) -> None:
    assert hapticd("export", "run.arrow", "--to", "mcap").code == 0
    Path("columns.yaml").write_text(
        "{device: rotary, time: {column: stamp, unit: ns}, position: {column: a.position}, current: {column: a.effort}}"
    )
    for words, said in (
        (("run.mcap", "--map", "columns.yaml"), "run.mcap describes itself: leave --map out"),
        (("run.csv",), "run.csv does not say what its columns are: give --map"),
        (("missing.mcap",), "cannot read missing.mcap"),
    ):
        outcome = hapticd("import", *words, "-o", "back.arrow")
        assert (outcome.code, outcome.out) == (2, "")
        assert said in outcome.err
        assert not Path("back.arrow").exists()


def test_a_run_that_exists_is_kept(hapticd: Run, run: Path) -> None:
    assert hapticd("export", "run.arrow", "--to", "mcap").code == 0
    before = run.read_bytes()
    assert hapticd("import", "run.mcap", "-o", "run.arrow").code == 2
    assert run.read_bytes() == before
    assert hapticd("import", "run.mcap", "-o", "run.arrow", "--force").code == 0
