"""``hapticd excite FILE``: settings for a while, the plan, and what is refused before anything moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from ..service.fake_control import FakeControl
from .conftest import Run


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "next.yaml"
    path.write_text(
        "{excitation: chirp, amplitude: 0.2, duration_s: 4, low_hz: 5, high_hz: 90, settings: {spring.stiffness: 0.004}}"
    )
    return path


def test_a_file_is_played_under_its_settings_which_are_taken_back(
    daemon: Run, control: FakeControl, file: Path
) -> None:
    before = control.resolved.spring.stiffness
    assert daemon("excite", str(file)).code == 0
    assert control.calls == [
        ("set", {"spring.stiffness": 0.004}),
        ("excite", "chirp", {"amplitude": 0.2, "duration_s": 4.0, "low_hz": 5.0, "high_hz": 90.0}),
        ("set", {"spring.stiffness": before}, "force"),
    ]


def test_settings_are_taken_back_after_a_refusal(daemon: Run, control: FakeControl, file: Path) -> None:
    file.write_text(file.read_text().replace("amplitude: 0.2", "amplitude: 200"))
    outcome = daemon("excite", str(file))
    assert outcome.code == 2
    assert "must be at most 2 A" in outcome.err
    assert control.calls[-1][0] == "set"
    assert control.resolved.spring.stiffness == 0.012


def test_settings_that_the_daemon_does_not_take_keep_the_motor_off(
    daemon: Run, control: FakeControl, file: Path
) -> None:
    file.write_text("{excitation: chirp, settings: {spring.stiffness: -1}}")
    assert daemon("excite", str(file)).code == 2
    assert [call[0] for call in control.calls] == ["set"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--amplitude", "1"), "stand in the file"),
        (("--low", "1"), "stand in the file"),
        (("--no-wait",), "must be taken back at the end"),
    ],
)
def test_what_does_not_go_with_a_file(
    daemon: Run, control: FakeControl, file: Path, words: tuple[str, ...], said: str
) -> None:
    outcome = daemon("excite", str(file), *words)
    assert outcome.code == 2
    assert said in outcome.err
    assert control.calls == []


def test_a_wrong_file_is_told_with_its_key(daemon: Run, control: FakeControl, file: Path) -> None:
    file.write_text("{excitation: chirp, amplitud: 0.2}")
    outcome = daemon("excite", str(file))
    assert outcome.code == 2
    assert f"{file}: amplitud: unknown key; did you mean amplitude?" in outcome.err
    assert daemon("excite", "nowhere.yaml").code == 2
    assert control.calls == []
