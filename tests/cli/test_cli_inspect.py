"""``hapticd inspect``, and its line before ``identify``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from .conftest import Run


@pytest.fixture
def measured(tmp_path: Path) -> Path:
    time_s = np.round(np.arange(6000) / 997.0, 3)
    counts = np.rint(3000 * np.sin(0.4 * time_s) * np.sin(20 * time_s))
    table = np.stack([time_s, counts, 0.2 * np.sin(3 * time_s)], 1)
    path = tmp_path / "lab.csv"
    header = "time_s,encoder_counts,current_command_A"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def test_what_a_recording_cannot_tell(hapticd: Run, measured: Path) -> None:
    outcome = hapticd("inspect", str(measured))
    assert outcome.code == 0
    assert "on a grid of 1 ms, 0 rows lost" in outcome.out
    assert "  cannot tell delay and lag (the command has nothing above " in outcome.out
    assert outcome.out.rstrip().endswith("next        hapticd excite chirp")
    found = hapticd("inspect", str(measured), "--json").document
    assert set(found) == {
        "run", "stamps", "position", "current", "excitation", "can_tell", "cannot_tell", "next_experiment",
    }  # fmt: skip
    both = hapticd("inspect", str(measured), str(measured), "--json").document
    assert both["runs"] == [found, found]
    assert (hapticd("inspect").code, hapticd("inspect", str(measured.with_name("no.csv"))).code) == (2, 2)


def test_its_line_comes_first(hapticd: Run, measured: Path) -> None:
    outcome = hapticd("identify", str(measured), "--model", "re35", "--known-inertia", "1 N")
    assert outcome.err.startswith("hapticd: lab.csv: 6.017 s at 997")
    assert "cannot tell: " in outcome.err.splitlines()[0]
