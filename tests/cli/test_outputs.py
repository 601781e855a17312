"""One rule for every file that a user names: what exists is refused before any work, by its name and --force."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from hapticd.cli.main import build_app, main
from hapticd.hil.suite import SuiteResult

from .conftest import Run

MINE = "of mine"
FIGURE = "out.png"
LINES: dict[str, tuple[str, str]] = {
    "plot": ("run.arrow -o", FIGURE),
    "export": ("run.arrow --to csv -o", "out.csv"),
    "import": ("data.csv --map map.yaml -o", "out.arrow"),
    "check": ("-o", FIGURE),
    "simulate": ("--duration 0.05 -o", "out.arrow"),
    "energy": ("run.arrow -o", FIGURE),
    "map": ("--beta-count 2 --sigma-count 2 --tau-d 0 --velocity 1 --periods 12 -o", "out.npz"),
    "zwidth": ("--points 2 -o", FIGURE),
    "reproduce": ("--only table2 -o", "out/index.html"),
    "identify": ("swing.arrow -o", "out.yaml"),
    "gap": ("swing.arrow -o", "out/report.html"),
    "hil": ("examples/serial-board.yaml -o", "out/report.html"),
    "hil --fault-matrix": ("examples/serial-board.yaml -o", "out/fault-matrix-serial_dac.md"),
    "commission": ("re35 --yes -o", "out/commission.html"),
    "init": ("--answers answers.yaml", "out.yaml"),
    "latency": ("--rate 200 --seconds 0.1 -o", FIGURE),
    "model export": ("--to mjcf -o", "out.xml"),
}
"""Command: its words before the name that it writes, and a file that it writes under it, or in it."""
NEVER = {
    "release": "its --force is the guard's, and the recording is kept elsewhere: never over a file",
    "excite": "likewise",
    "recover": "each run gets a name that no file has",
    "metrics": "a timer writes the same file again and again",
}
"""Outputs without a --force of this kind, and why."""
SHORTER = {"gap": ["--effect", "gravity"], "commission": ["--only", "doctor"]}
"""What ends a long command sooner."""


def _outputs(command: Any, path: str = "") -> Iterator[str]:
    for name, child in getattr(command, "commands", {}).items():
        yield from _outputs(child, f"{path} {name}".strip())
    if any(parameter.name == "out" for parameter in command.params):
        yield path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording, a table with its map, and answers."""
    folder = tmp_path_factory.mktemp("outputs")
    run = folder / "run.arrow"
    assert main(["simulate", "--duration", "0.3", "--deflection", "20.3", "-o", str(run), "--quiet"]) == 0
    swing = ["--duration", "2", "--deflection", "800", "--set", "plant.coulomb=1e-4", "-o", str(folder / "swing.arrow")]
    assert main(["simulate", *swing, "--quiet"]) == 0
    rows = "".join(f"{0.001 * row:.3f},{row // 3},0.1\n" for row in range(100))
    (folder / "data.csv").write_text(f"t,q,i\n{rows}")
    (folder / "map.yaml").write_text(
        "device: rotary\ntime: {column: t}\nposition: {column: q, unit: count}\n"
        "current: {column: i, unit: A}\nencoder: {counts_per_rev: 4096}\n"
    )
    (folder / "answers.yaml").write_text("{}")
    return folder


def _words(made: Path, command: str, out: Path) -> list[str]:
    kept = {path.name: str(path) for path in made.iterdir()} | {
        "examples/serial-board.yaml": str(Path(__file__).parents[2] / "examples/serial-board.yaml")
    }
    before, name = LINES[command]
    target = out / Path(name).parts[0]
    return [*command.split(), *(kept.get(word, word) for word in before.split()), str(target)]


def test_every_command_that_writes_a_named_file_is_here() -> None:
    found = set(_outputs(typer.main.get_command(build_app())))
    assert found == {command.partition(" --")[0] for command in LINES} | set(NEVER)


@pytest.mark.parametrize("command", LINES)
def test_a_file_that_exists_is_refused_by_its_name(command: str, made: Path, tmp_path: Path, hapticd: Run) -> None:
    mine = tmp_path / LINES[command][1]
    mine.parent.mkdir(exist_ok=True)
    mine.write_text(MINE)
    refused = hapticd(*_words(made, command, tmp_path))
    assert refused.code == 2, refused.err
    assert str(mine) in refused.err
    assert "--force" in refused.err
    assert [path.read_bytes() for path in mine.parent.iterdir()] == [MINE.encode()]
    assert "--force" in hapticd(*command.partition(" --")[0].split(), "--help").out


@pytest.mark.filterwarnings("ignore:No artists with labels")
@pytest.mark.parametrize("command", LINES)
def test_force_replaces_it_whole(
    command: str, made: Path, tmp_path: Path, hapticd: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A board and a daemon in real time are for tests/hil: here it is their report.
    nothing = SuiteResult("serial_dac", (), np.empty(0), 0.0, defaultdict(int), ())
    monkeypatch.setattr("hapticd.hil.suite.run_suite", lambda *given, **more: nothing)
    monkeypatch.setattr("hapticd.hil.matrix.run_matrix", lambda *given, **more: [])
    mine = tmp_path / LINES[command][1]
    mine.parent.mkdir(exist_ok=True)
    mine.write_text(MINE)
    link = tmp_path / "link"
    link.hardlink_to(mine)
    done = hapticd(*_words(made, command, tmp_path), *SHORTER.get(command, ()), "--force")
    assert done.code in (0, 1), done.err
    assert mine.read_bytes() != MINE.encode(), done.err + done.out
    assert link.read_text() == MINE, "it was written into, not replaced by a whole one"
    assert not list(tmp_path.rglob(".*")), "a scratch file is left"
