"""A small part of the blind benchmark with fixed seeds: the same generator, the same seal, the same scores.

The runs are short, so that all of it takes well under a minute; `python -m benchmarks.gap` has the rates.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from benchmarks.gap import collect, report, summary
from benchmarks.gap.plan import Case
from benchmarks.gap.summary import Scored

SECONDS = 5.0
CASES = {
    "named": Case("single", ("coulomb_friction",), "strong", 101, "re35", "csv", SECONDS),
    "delayed": Case("single", ("transport_delay",), "strong", 102, "re35", "arrow", SECONDS),
    "none": Case("none", (), "none", 103, "re35", "parquet", SECONDS),
    "left_out": Case("left_out", ("encoder_eccentricity",), "strong", 104, "re35", "csv", SECONDS),
}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The benchmark's folder, with every case answered by the workflow."""
    folder = tmp_path_factory.mktemp("blind")
    with ThreadPoolExecutor(1) as pool:
        collect.run(list(CASES.values()), collect.Store(folder), ["workflow"], pool, 1)
    return folder


@pytest.fixture(scope="module")
def scored(root: Path) -> dict[str, Scored]:
    """The answers beside the truth, which is opened here for the first time."""
    by_name = {one.truth["name"]: one for one in summary.load(root, "workflow")}
    return {label: by_name[case.name] for label, case in CASES.items()}


def test_the_workflow_was_given_the_run_and_the_nominal_model_only(root: Path) -> None:
    for label, case in CASES.items():
        folder = root / "cases" / case.name
        assert {path.name for path in folder.iterdir()} == {f"run.{case.form}", "model.yaml"}, label
        for path in folder.iterdir():
            assert not any(slug.encode() in path.read_bytes() for slug in case.slugs), label


@pytest.mark.parametrize("label", ["named", "delayed"])
def test_a_strong_effect_is_named_and_its_gap_closes(scored: dict[str, Scored], label: str) -> None:
    one = scored[label]
    assert summary.is_right(one), one.answer.get("error", one.answer.get("statement"))
    assert one.answer["gap"]["held_out"]["before"] > 3.0
    assert (summary.held_out_after(one.answer) or 9.9) < 1.2
    assert one.answer["residual_structure"]["p_value"] > one.answer["residual_structure"]["level"]


def test_nothing_is_named_where_nothing_is_hidden(scored: dict[str, Scored]) -> None:
    assert scored["none"].answer["verdict"] == "no_missing_effect", scored["none"].answer.get("error")


def test_what_the_catalogue_lacks_gets_no_confident_name(scored: dict[str, Scored]) -> None:
    one = scored["left_out"]
    assert "error" not in one.answer
    assert one.answer["verdict"] == "unexplained"
    assert not summary.is_wrong(one)


def test_the_report_says_how_often_intervals_hold_the_truth(root: Path) -> None:
    text = report.write(root, len(CASES))
    lines = {line[:38].strip(): line[38:].split() for line in text.splitlines()}
    hits, of = lines["size inside its 95 % interval"][2].strip("(;").split("/")
    assert 0 <= int(hits) <= int(of) == 2
