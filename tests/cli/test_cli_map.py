from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from hapticd.stability import map_engines
from hapticd.stability.maps import Chunk

from .conftest import Run

SMALL = ("--periods", "20000", "--beta-count", "6", "--sigma-count", "4", "--sigma-max", "1.2")


def test_it_reports_every_region_and_writes_maps_and_figure(hapticd: Run, tmp_path: Path) -> None:
    out = tmp_path / "maps.npz"
    outcome = hapticd("map", *SMALL, "-o", str(out), "--json")
    report = outcome.document
    assert outcome.code == 0
    assert report["holds"] is True
    assert report["points"] == report["done"] == 8 * 24
    assert sum(region["points"] for region in report["regions"].values()) == 8 * 24
    assert [(entry["tau_d"], entry["xi_dot_0"]) for entry in report["maps"]] == [
        (tau_d, velocity) for tau_d in (0.0, 1.25) for velocity in (1.0, 5.0, 10.0, 50.0)
    ]
    assert report["output"] == str(out)
    assert report["figure"] == str(tmp_path / "maps.png")
    assert (tmp_path / "maps.png").stat().st_size > 0
    with np.load(out, allow_pickle=False) as file:
        assert file["outcome"].shape == (2, 4, 6, 4)
        assert file["done"].all()


def test_maps_without_a_suffix_get_one(hapticd: Run, tmp_path: Path) -> None:
    words = ("map", "--periods", "2000", "--beta-count", "1", "--sigma-count", "1", "--tau-d", "0", "--velocity", "1")
    report = hapticd(*words, "-o", str(tmp_path / "maps"), "--json").document
    assert report["output"] == str(tmp_path / "maps.npz")
    assert {path.name for path in tmp_path.iterdir()} == {"maps.npz", "maps.png"}


def test_options_reach_the_study(hapticd: Run, tmp_path: Path) -> None:
    options = [
        "--mu",
        "30",
        "--tau-d",
        "0.5",
        "--velocity",
        "2",
        "--velocity",
        "3",
        "--beta-max",
        "2",
        "--sigma-max",
        "1",
    ]
    counts = ["--periods", "400", "--beta-count", "6", "--sigma-count", "4"]
    path = tmp_path / "half.npz"
    assert hapticd("map", *counts, *options, "-o", str(path), "--no-figure").code in (0, 1)
    with np.load(path, allow_pickle=False) as file:
        np.testing.assert_allclose(file["beta"], [np.arange(1, 7) / 3.0])
        np.testing.assert_allclose(file["sigma"], [0.25, 0.5, 0.75, 1.0])
        np.testing.assert_array_equal(file["tau_d"], [0.5])
        np.testing.assert_array_equal(file["xi_dot_0"], [2.0, 3.0])
        assert '"mu": 30.0' in str(file["metadata"])
    assert [entry.name for entry in tmp_path.iterdir()] == ["half.npz"]


def test_the_text_is_a_table_of_regions(hapticd: Run, tmp_path: Path) -> None:
    outcome = hapticd("map", *SMALL, "-o", str(tmp_path / "maps.npz"), "--no-figure")
    lines = outcome.out.splitlines()
    assert lines[0] == "192 of 192 points, mu = 100"
    assert lines[1].split() == ["region", "points", "monotone", "decaying", "persistent", "growing", "agree"]
    assert [line.split()[0] for line in lines[2:8]] == ["A", "B", "C", "D", "E", "F1"]
    assert lines[2].endswith("100 %")
    assert lines[5].endswith("no claim")


def test_an_interrupt_keeps_what_is_done_and_the_same_command_goes_on(
    hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "maps.npz"
    command = ("map", *SMALL, "-o", str(path))
    real = map_engines.local

    def stopped(wanted: list[Chunk], jobs: int | None) -> map_engines.Results:
        for k, result in enumerate(real(wanted, jobs)):
            if k == 3:
                raise KeyboardInterrupt
            yield result

    with monkeypatch.context() as patch:
        patch.setattr(map_engines, "local", stopped)
        outcome = hapticd(*command, "--json")
    assert (outcome.code, outcome.document["done"]) == (130, 72)
    assert f"{path} keeps 72 of 192 points; the same command goes on from there" in outcome.err
    assert [entry.name for entry in tmp_path.iterdir()] == ["maps.npz"]
    again = hapticd(*command, "--json")
    assert (again.code, again.document["done"]) == (0, 192)
    assert "has 72 of 192 points already" in again.err
    whole = hapticd("map", *SMALL, "-o", str(tmp_path / "whole.npz"), "--json")
    assert again.document["maps"] == whole.document["maps"]


def test_other_options_never_replace_a_file(hapticd: Run, tmp_path: Path) -> None:
    path = tmp_path / "maps.npz"
    hapticd("map", *SMALL, "-o", str(path), "--no-figure")
    before = path.read_bytes()
    refused = hapticd("map", *SMALL, "--mu", "50", "-o", str(path), "--no-figure")
    assert (refused.code, path.read_bytes()) == (2, before)
    assert refused.err == (
        f"hapticd: {path} contains maps made with other options (mu 100.0): "
        "choose another -o, or replace it with --force\n"
    )  # fmt: skip
    assert hapticd("map", *SMALL, "--mu", "50", "-o", str(path), "--no-figure", "--force").code == 0


def test_a_contradiction_ends_in_1_and_is_listed(hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hapticd.stability import map_report

    monkeypatch.setitem(map_report.PROMISED, "B", frozenset({"monotone"}))
    outcome = hapticd("map", *SMALL, "-o", str(tmp_path / "maps.npz"), "--no-figure")
    assert outcome.code == 1
    assert "against theory: " in outcome.out
    assert "  B: beta 0.5, sigma 0.3" in outcome.out.split("against theory")[1]
    assert "more with --json" in outcome.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--figure", "a.gif"), "a.gif: a figure is one of png, svg, pdf"),
        (("--figure", "a.png", "--no-figure"), "--figure and --no-figure exclude each other"),
        (("--jobs", "2", "--dask", "tcp://x:1"), "--jobs is for this machine"),
        (("--velocity", "-1"), "velocities must be one or more numbers of at least 0"),
        (("--tau-d", "1", "--tau-d", "1"), "delays has a number twice"),
        (("-o", "nowhere/maps.npz"), "nowhere/maps.npz cannot be written"),
        (("--periods", "3"), "--periods"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = hapticd("map", *SMALL, *words)
    assert (outcome.code, outcome.out) == (2, "")
    assert message in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_dask_without_its_package_says_what_to_install(
    hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    outcome = hapticd("map", *SMALL, "--dask", "tcp://127.0.0.1:1", "-o", str(tmp_path / "maps.npz"))
    assert outcome.code == 2
    assert "pip install 'hapticd[dask]'" in outcome.err
    assert list(tmp_path.iterdir()) == []
