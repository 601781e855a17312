"""A small part of the blind benchmark with fixed seeds: the same generator, the same seal, the same scores.

The runs are short, so that all of it takes well under a minute; `python -m benchmarks.gap` has the rates.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from benchmarks.gap import collect, report, summary, tasks
from benchmarks.gap.collect import Asked
from benchmarks.gap.plan import Case
from benchmarks.gap.summary import Scored

SECONDS = 5.0
CASES = {
    "named": Case("single", ("coulomb_friction",), (1.0,), 50, 0, "re35", "csv", SECONDS),
    "delayed": Case("single", ("transport_delay",), (1.0,), 50, 1, "re35", "arrow", SECONDS),
    "none": Case("none", (), (), 50, 2, "re35", "parquet", SECONDS),
    "left_out": Case("left_out", ("encoder_eccentricity",), (1.0,), 50, 3, "re35", "csv", SECONDS),
}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The benchmark's folder, with every case answered by the workflow."""
    folder = tmp_path_factory.mktemp("blind")
    with ThreadPoolExecutor(1) as pool:
        collect.run(list(CASES.values()), collect.Store(folder), {"workflow": Asked(tasks.workflow)}, pool, 1)
    return folder


@pytest.fixture(scope="module")
def scored(root: Path) -> dict[str, Scored]:
    """The answers beside the truth, which is opened here for the first time."""
    found = summary.load(root, "workflow", CASES.values())
    return dict(zip(CASES, found, strict=True))


def test_the_workflow_was_given_the_run_and_the_nominal_model_only(root: Path) -> None:
    for label, case in CASES.items():
        folder = root / "cases" / case.name
        assert {path.name for path in folder.iterdir()} == {f"run.{case.form}", "model.yaml"}, label
        for path in folder.iterdir():
            assert not any(slug.encode() in path.read_bytes() for slug in case.slugs), label


@pytest.mark.parametrize("label", ["named", "delayed"])
def test_a_strong_effect_is_named(scored: dict[str, Scored], label: str) -> None:
    one = scored[label]
    assert summary.is_named(one), one.answer.get("error", one.answer.get("statement"))
    assert not summary.has_wrong_further(one)


def test_nothing_is_named_where_nothing_is_hidden(scored: dict[str, Scored]) -> None:
    assert scored["none"].answer["verdict"] == "no_missing_effect", scored["none"].answer.get("error")


def test_what_the_catalogue_lacks_gets_no_confident_name(scored: dict[str, Scored]) -> None:
    one = scored["left_out"]
    assert "error" not in one.answer
    assert not summary.is_wrong(one)


def test_the_report_says_how_often_intervals_hold_the_truth(root: Path) -> None:
    text = report.write(root, list(CASES.values()))
    line = next(line for line in text.splitlines() if line.startswith("inside the 95 % intervals"))
    hits, of = line.partition("(")[2].partition(";")[0].split("/")
    assert 0 <= int(hits) <= int(of) == 2
