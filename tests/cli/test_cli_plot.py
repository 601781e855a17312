"""``hapticd plot`` and ``hapticd runs``: by name, over each other, and what is refused."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hapticd.cli.completion import complete_run

from .conftest import Run


@pytest.fixture
def recordings(hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two releases in the user's own folder, the second with more friction, and an empty working folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    folder = tmp_path / "state/hapticd/runs"
    folder.mkdir(parents=True)
    for at, (name, viscous) in enumerate((("one", "9e-6"), ("two", "1.2e-5"))):
        path = folder / f"{name}.arrow"
        words = ("--deflection", "20.3", "--set", "encoder.decimation=217", "--set", f"plant.viscous={viscous}")
        assert hapticd("simulate", "--duration", "0.4", *words, "-o", str(path)).code == 0
        os.utime(path, (1e9 + at, 1e9 + at))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return folder


def test_the_newest_is_drawn_here_under_its_name(hapticd: Run, recordings: Path) -> None:
    outcome = hapticd("plot", "@last")
    assert (outcome.code, outcome.err) == (0, "")
    assert Path("two.png").stat().st_size > 20_000
    assert outcome.out.startswith(str(recordings / "two.arrow"))
    assert outcome.out.endswith("figure two.png\n")


def test_two_runs_and_their_difference(hapticd: Run, recordings: Path) -> None:
    found = hapticd("plot", "@last~1", "@last", "-o", "both.svg", "--json").document
    assert [Path(each["run"]).stem for each in found["runs"]] == ["one", "two"]
    drawn = Path("both.svg").read_text()
    assert "one.arrow and two.arrow" in drawn.replace("<!-- ", "").replace(" -->", "")
    position = found["difference"]["position"]
    assert position["unit"] == "rad"
    assert 0.0 < position["rms"] < position["max"] < 1.0
    back = hapticd("plot", "@last", "@last~1", "-o", "back.svg", "--json").document["difference"]["position"]
    assert back == position


def test_a_run_less_itself_is_nothing(hapticd: Run, recordings: Path) -> None:
    found = hapticd("plot", "two.arrow", "@last", "--only", "difference", "--json").document
    assert found["difference"]["position"]["max"] == found["difference"]["command"]["max"] == 0.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("@last~2",), "@last~2: 2 recording(s) in"),
        (("@last", "--only", "spektrum"), "the panels are trace, phase"),
        (("@last", "--only", "difference"), "it needs a second run"),
        (("@last", "-o", "x.gif"), "a figure is a .pdf, .png, .svg file"),
        (("missing.arrow",), "cannot read missing.arrow"),
    ],
)
def test_what_is_refused(hapticd: Run, recordings: Path, words: tuple[str, ...], said: str) -> None:
    outcome = hapticd("plot", *words)
    assert (outcome.code, outcome.out) == (2, "")
    assert said in outcome.err
    assert list(Path().iterdir()) == []


def test_a_foreign_file_without_config_is_drawn_in_counts(hapticd: Run, recordings: Path) -> None:
    Path("foreign.csv").write_text(
        "time_s,encoder_counts,current_command_A\n" + "".join(f"{k / 1000},{k % 40},0.1\n" for k in range(200))
    )
    found = hapticd("plot", "foreign.csv", "--json").document["runs"][0]
    assert found["position"]["unit"] == "count"
    assert found["energy"] is None
    with_model = hapticd("plot", "foreign.csv", "--config", "re35", "--force", "--json").document["runs"][0]
    assert with_model["position"]["unit"] == "rad"


@pytest.mark.parametrize("command", [("energy",), ("export", "--to", "csv", "-o", "x.csv")])
def test_last_is_taken_wherever_a_run_is_asked_for(hapticd: Run, recordings: Path, command: tuple[str, ...]) -> None:
    found = hapticd(*command, "@last", "--json")
    assert found.code == 0
    assert found.document["run"] == str(recordings / "two.arrow")


def test_gap_takes_last(hapticd: Run, recordings: Path) -> None:
    outcome = hapticd("gap", "@last~7", "-o", "gap")
    assert outcome.code == 2
    assert "@last~7: 2 recording(s)" in outcome.err


def test_runs_lists_the_newest_first(hapticd: Run, recordings: Path) -> None:
    (recordings / "broken.arrow").write_bytes(b"no run")
    os.utime(recordings / "broken.arrow", (1.0, 1.0))
    lines = hapticd("runs").out.splitlines()
    assert lines[0].split()[0] == "@last"
    assert "400 rows" in lines[0]
    assert "two.arrow" in lines[0]
    assert lines[1].startswith("@last~1 ")
    assert "no run file" in lines[2]
    assert lines[3] == f"in {recordings}"
    document = hapticd("runs", "-n", "1", "--json").document
    assert document["total"] == 3
    assert [run["rows"] for run in document["runs"]] == [400]


def test_runs_of_other_folders(hapticd: Run, recordings: Path) -> None:
    assert hapticd("runs", ".").out == "no recordings in .\n"
    outcome = hapticd("runs", "nowhere")
    assert outcome.code == 2
    assert "nowhere is not a folder" in outcome.err


def test_a_shell_completes_runs(recordings: Path) -> None:
    Path("here.csv").write_text("")
    assert complete_run("")[:3] == ["@last", "two.arrow", "one.arrow"]
    assert complete_run("o") == ["one.arrow"]
    assert complete_run("her") == ["here.csv"]
    assert str(recordings / "one.arrow") in complete_run(f"{recordings}/o")


def test_bode_is_refused_without_a_chirp_and_beside_another_run(hapticd: Run, recordings: Path) -> None:
    outcome = hapticd("plot", "@last", "--bode")
    assert outcome.code == 2
    assert "'hapticd excite chirp' records one" in outcome.err
    assert hapticd("plot", "@last", "@last~1", "--bode").code == 2
    assert not list(Path().glob("*.png"))
