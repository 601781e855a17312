"""``hapticd import``, and what reads its runs."""

from __future__ import annotations

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


def test_a_run_that_exists_is_kept(hapticd: Run, measured: Path) -> None:
    words = ("import", str(measured / "lab.csv"), "--map", str(measured / "map.yaml"), "-o", str(measured / "r.arrow"))
    assert hapticd(*words).code == 0
    refused = hapticd(*words)
    assert refused.code == 2
    assert "--force" in refused.err
    assert hapticd(*words, "--force").code == 0
