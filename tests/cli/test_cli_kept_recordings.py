"""``-o`` of ``release`` and ``excite``: the recording where its user wants it."""

from __future__ import annotations

from pathlib import Path

import pytest

from ..service.fake_control import FakeControl
from .conftest import Run

COMMANDS = [("release", "--deflection", "3"), ("excite", "chirp")]


@pytest.fixture
def recorded(control: FakeControl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the daemon recorded, somewhere else."""
    path = tmp_path / "run-1.arrow"
    path.write_bytes(b"rows")
    control.job_result = {"run": str(path)}
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return path


@pytest.mark.parametrize("words", COMMANDS)
def test_the_recording_is_copied_and_stays(daemon: Run, recorded: Path, words: tuple[str, ...]) -> None:
    outcome = daemon(*words, "-o", "wall.arrow", "--json")
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.document["copy"] == "wall.arrow"
    assert Path("wall.arrow").read_bytes() == recorded.read_bytes() == b"rows"
    assert [path.name for path in Path().iterdir()] == ["wall.arrow"]


def test_a_release_says_where_the_copy_is(daemon: Run, recorded: Path) -> None:
    assert "copied to    wall.arrow" in daemon("release", "--deflection", "3", "-o", "wall.arrow").out


@pytest.mark.parametrize(
    ("out", "more", "said"),
    [
        ("there.arrow", (), "there.arrow exists: a recording never overwrites a file"),
        ("no/folder.arrow", (), "there is no folder no"),
        ("wall.csv", (), "write wall.arrow, then 'hapticd export wall.arrow --to csv'"),
        ("wall.arrow", ("--no-wait",), "--no-wait returns before the recording is over"),
    ],
)
@pytest.mark.parametrize("words", COMMANDS)
def test_refused_before_anything_moves(
    daemon: Run,
    control: FakeControl,
    recorded: Path,
    words: tuple[str, ...],
    out: str,
    more: tuple[str, ...],
    said: str,
) -> None:
    Path("there.arrow").write_bytes(b"mine")
    outcome = daemon(*words, "-o", out, *more)
    assert (outcome.code, outcome.out) == (2, "")
    assert said in outcome.err
    assert control.calls == []
    assert Path("there.arrow").read_bytes() == b"mine"


def test_a_copy_that_fails_says_where_the_recording_is(daemon: Run, recorded: Path) -> None:
    recorded.unlink()
    outcome = daemon("release", "--deflection", "3", "-o", "wall.arrow", "--json")
    assert outcome.code == 0
    assert f"the recording is {recorded}; it cannot be copied to wall.arrow: No such file" in outcome.err
    assert "copy" not in outcome.document
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        (("release", "--deflection", "434counts"), ("release", pytest.approx(2.0), None)),
        (("release", "--deflection", "-3.5ticks", "--duration", "500ms"), ("release", -3.5, 0.5)),
        (
            ("excite", "chirp", "--low", "500mHz", "--high", "0.2kHz"),
            ("excite", "chirp", {"low_hz": 0.5, "high_hz": pytest.approx(200.0)}),
        ),
        (("excite", "chirp", "--amplitude", "200mA"), ("excite", "chirp", {"amplitude": pytest.approx(0.2)})),
    ],
)
def test_units_are_taken_through_the_config_in_force(
    daemon: Run, control: FakeControl, words: tuple[str, ...], asked: tuple[object, ...]
) -> None:
    assert daemon("set", "encoder.decimation=217").code == 0
    assert daemon(*words).code == 0
    assert control.calls[1:] == [asked]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("release", "--deflection", "2mm"), "the device is rotary"),
        (("excite", "chirp", "--amplitude", "3deg"), "unknown unit 'deg'"),
        (("excite", "--amplitude", "3mA"), "'all' has amplitudes of several kinds"),
        (("excite", "chirp", "--amplitude", "-1"), "--amplitude -1 is not above zero"),
    ],
)
def test_units_of_the_wrong_kind_move_nothing(
    daemon: Run, control: FakeControl, words: tuple[str, ...], said: str
) -> None:
    outcome = daemon(*words)
    assert (outcome.code, outcome.out) == (2, "")
    assert said in outcome.err
    assert control.calls == []
