"""Run files of every version so far, each written by `hapticd.servo.simulate` of its time, commits 4f6911a and 38665ca.

Both hold the same ten ticks, written down in ``rows.json`` before they went into the file.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hapticd.config import parse_config
from hapticd.record import ROW, read_run, verify
from hapticd.record.metadata import FORMAT_VERSION

OLD = Path(__file__).parent / "old_runs"


@pytest.mark.parametrize("version", range(1, FORMAT_VERSION + 1))
def test_an_old_run_has_the_values_it_was_written_with(version: int) -> None:
    path = OLD / f"version-{version}.arrow"
    run = read_run(path)
    written = json.loads((OLD / "rows.json").read_text(encoding="utf-8"))
    assert list(run.columns) == list(written) == list(ROW.names or ())
    for name, values in written.items():
        assert run.columns[name].dtype == ROW[name]
        np.testing.assert_array_equal(run.columns[name], values)
    assert (run.truncated, run.warnings) == (False, ())
    about = run.metadata
    assert (about["format_version"], about["source"], about["label"]) == (version, "simulate", "bench")
    config = parse_config(about["config"], str(path))
    assert (config.encoder.decimation, config.spring.stiffness) == (217, 0.2)
    verdict = verify(path)
    assert (verdict.version, verdict.checked, verdict.rows, verdict.damage) == (version, version > 1, run.rows, [])
