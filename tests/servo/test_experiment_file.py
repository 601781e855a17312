"""Experiment files: what is read, and what is said of every mistake."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from hapticd.config import ConfigError
from hapticd.servo.experiment import Experiment, names_file, read_experiment

WHOLE = Experiment("chirp", 0.4, 8.0, 5.0, 200.0, 3, {"spring.stiffness": 0.004, "encoder.decimation": 1})


def test_a_file_of_its_own_document_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "next.yaml"
    for experiment in (WHOLE, Experiment("all"), Experiment("release", duration_s=4.0)):
        path.write_text(yaml.safe_dump(experiment.document()))
        assert read_experiment(path) == experiment


def test_only_what_is_given_is_left_to_be_asked_for() -> None:
    assert Experiment("steps", amplitude=0.1).plan() == {"amplitude": 0.1}
    assert WHOLE.describe() == (
        "chirp of 0.4 A from 5 to 200 Hz for 8 s with spring.stiffness = 0.004 and encoder.decimation = 1"
    )
    assert Experiment("sweep", 0.01, 4.0).describe(is_linear=True) == "sweep of 0.01 m for 4 s"


@pytest.mark.parametrize("name", ["x.yaml", "x.yml", "./chirp", "gap/next_experiment.yaml"])
def test_files_are_told_from_shapes(name: str) -> None:
    assert names_file(name)
    assert not names_file("chirp")


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ("", "", "contains no experiment"),
        ("[chirp]", "", "contains no experiment"),
        ("{amplitude: 1}", "excitation", "must be one of ramp, sweep"),
        ("excitation: chrip", "excitation", "did you mean chirp?"),
        ("{excitation: chirp, amplitud: 1}", "amplitud", "did you mean amplitude?"),
        ("{excitation: chirp, amplitude: -1}", "amplitude", "must be a number above 0 A, rad or m"),
        ("{excitation: chirp, duration_s: long}", "duration_s", "must be a number above 0 s"),
        ("{excitation: chirp, high_hz: .inf}", "high_hz", "must be a number above 0 Hz"),
        ("{excitation: steps, seed: 1.5}", "seed", "must be a whole number"),
        ("{excitation: steps, settings: 3}", "settings", "must be a mapping"),
        (
            "{excitation: steps, settings: {spring.stifness: 1}}",
            "settings.spring.stifness",
            "did you mean spring.stiffness?",
        ),
        (
            "{excitation: steps, settings: {plant.inertia: 1}}",
            "settings.plant.inertia",
            "not a setting that can change",
        ),
        ("{excitation: steps, settings: {spring.stiffness: [1]}}", "settings.spring.stiffness", "must be one value"),
        ("{excitation: steps, excitation: chirp}", "excitation", "given twice"),
    ],
)
def test_every_mistake_is_named_with_file_and_key(tmp_path: Path, text: str, key: str, words: str) -> None:
    path = tmp_path / "next.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        read_experiment(path)
    (problem,) = refused.value.problems
    assert (problem.file, problem.key) == (str(path), key)
    assert words in problem.message


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "next.yaml"
    path.write_text("{excitation: x, amplitude: 0, seed: -1}")
    with pytest.raises(ConfigError) as refused:
        read_experiment(path)
    assert [problem.key for problem in refused.value.problems] == ["excitation", "amplitude", "seed"]
