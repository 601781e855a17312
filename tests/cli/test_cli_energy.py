"""``hapticd energy``: the ledger of a run file, in words, as JSON and as a figure."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from .conftest import Run


@pytest.fixture
def recorded(hapticd: Run, tmp_path: Path) -> Path:
    path = tmp_path / "run.arrow"
    words = ("--duration", "0.8", "--deflection", "20.3", "--set", "encoder.decimation=217", "-o", str(path))
    assert hapticd("simulate", *words).code == 0
    return path


def test_json(hapticd: Run, recorded: Path) -> None:
    outcome = hapticd("energy", str(recorded), "--json")
    found = outcome.document
    assert (outcome.code, outcome.err) == (0, "")
    assert found["estimate"].startswith("through the model")
    assert found["rows"] == 800
    # half of 20.5 · 20 and 0.3 · 20.5, in KΔ²
    assert found["stored_J"]["start"] / found["unit_J"] == pytest.approx(0.5 * 400.0 + 20.5 * 0.3, rel=1e-3)
    balance = (
        found["stored_J"]["start"] - found["dissipated_J"]["total"] + found["generated_J"] + found["unexplained_J"]
    )
    assert balance == pytest.approx(found["stored_J"]["end"], abs=1e-12)
    assert found["explained"] > 0.999
    assert found["bounds"]["violations"]["paper"] > 0
    assert 0 <= found["bounds"]["violations"]["paper"] < found["bounds"]["intervals"]


def test_words(hapticd: Run, recorded: Path) -> None:
    outcome = hapticd("energy", str(recorded))
    assert outcome.code == 0
    assert outcome.out.startswith("Estimated through the model")
    for word in ("stored", "dissipated", "generated", "unexplained", "bounds", "Coulomb", "the model explains"):
        assert word in outcome.out


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_a_figure_is_written(hapticd: Run, recorded: Path, suffix: str) -> None:
    path = recorded.with_name(f"ledger.{suffix}")
    outcome = hapticd("energy", str(recorded), "-o", str(path), "--json")
    assert outcome.document["figure"] == str(path)
    assert path.stat().st_size > 10_000


def test_a_mass_that_never_moves_has_a_ledger_and_a_figure(hapticd: Run, tmp_path: Path) -> None:
    run, figure = tmp_path / "run.arrow", tmp_path / "ledger.svg"
    assert hapticd("simulate", "--duration", "0.1", "--deflection", "3.3", "-o", str(run)).code == 0
    outcome = hapticd("energy", str(run), "-o", str(figure), "--json")
    assert outcome.code == 0
    assert outcome.document["dissipated_J"]["total"] == 0.0
    assert outcome.document["explained"] is None
    assert "no period in which the mass moved" in figure.read_text()


def test_exports_work_and_foreign_files_need_a_config(hapticd: Run, recorded: Path) -> None:
    assert hapticd("export", str(recorded), "--to", "csv").code == 0
    path = recorded.with_suffix(".csv")
    same = hapticd("energy", str(path), "--json").document
    assert same["generated_J"] == pytest.approx(hapticd("energy", str(recorded), "--json").document["generated_J"])
    with path.open(newline="") as file:
        rows = [row[:-1] for row in csv.reader(file)]  # without the column of the metadata
    foreign = recorded.with_name("foreign.csv")
    foreign.write_text("\n".join(map(",".join, rows)))
    refused = hapticd("energy", str(foreign))
    assert (refused.code, refused.out) == (2, "")
    assert "carries no config" in refused.err
    given = hapticd("energy", str(foreign), "--config", "re35", "--json")
    assert given.code == 0


@pytest.mark.parametrize(
    ("name", "words", "said"),
    [
        ("nowhere.arrow", (), "cannot read"),
        ("text.arrow", (), "is not a run file"),
        ("text.arrow", ("-o", "x.bmp"), "a figure is a"),
        ("text.arrow", ("--config", "omege"), "is not a run file"),
    ],
)
def test_what_cannot_be_read_exits_2(
    hapticd: Run, tmp_path: Path, name: str, words: tuple[str, ...], said: str
) -> None:
    (tmp_path / "text.arrow").write_text("not an Arrow stream at all")
    outcome = hapticd("energy", str(tmp_path / name), *words)
    assert (outcome.code, outcome.out) == (2, "")
    assert said in outcome.err
