"""The measured data sets, where they are (HAPTICD_DATASETS); they are not part of the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchmarks.gap_real import emps, odrive
from benchmarks.gap_real.datasets import VARIABLE, folder
from benchmarks.report import BenchmarkError

needs_data = pytest.mark.skipif(
    not Path(os.environ.get(VARIABLE) or "/nowhere").is_dir(),
    reason=f"needs measured data: name their folder in {VARIABLE}",
)


@needs_data
def test_emps_keeps_its_goals(tmp_path: Path) -> None:
    figures = {figure.name: figure for figure in emps.measure(folder(), tmp_path)}
    assert [name for name, figure in figures.items() if figure.met is False] == []
    assert figures["EMPS rigid, residual force RMS"].value == pytest.approx(3.82, rel=0.02)
    assert figures["EMPS with offset"].value == pytest.approx(2.16, rel=0.03)
    assert figures["EMPS with asymmetric viscous"].value == pytest.approx(1.64, rel=0.05)


@needs_data
def test_cogging_motor_keeps_its_goals(tmp_path: Path) -> None:
    figures = odrive.measure(folder(), tmp_path)
    assert [figure.name for figure in figures if figure.met is False] == []
    orders = figures[1].details["orders"]
    assert orders[:3] == [7.0, 28.0, 14.0]


def test_without_data_the_benchmark_says_what_it_needs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(BenchmarkError, match=f"name their folder in {VARIABLE}"):
        folder()
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with pytest.raises(BenchmarkError, match=r"lacks emps/DATA_EMPS\.mat"):
        folder()
