"""``gap --live``: which steps are taken, what is kept, and that an interrupted shaft stands still."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from hapticd.client import Client
from hapticd.config import parse_config
from hapticd.gap import GapResult
from hapticd.gap.live import LiveError, find_gap_live
from hapticd.gap.result import GapNumbers, Remainder
from hapticd.servo.experiment import Experiment

MODEL = parse_config({}, "model")
PLAN = {"excitation": "release", "amplitude": 0.3, "duration_s": 4.0, "settings": {"encoder.decimation": 1}}
AMBIGUOUS = {"words": "Play it.", "separates": ["a", "b"], "expected": 9.0, "experiment": PLAN}


def result(verdict: Any, planned: dict[str, Any] | None = None) -> GapResult:
    numbers, left = GapNumbers(2e-3, 1e-3, 2e-3, 1e-3, 1e-4, "N m"), Remainder(0.25, "A quarter is left.", ())
    return GapResult(verdict, f"It is {verdict}.", (), (), numbers, left, next_experiment=planned)


@dataclass
class FakeDaemon:
    """Notes what it is asked; ``reports`` are the ends of its experiments."""

    reports: list[dict[str, Any] | BaseException]
    calls: list[Any] = field(default_factory=list)

    def config(self) -> dict[str, Any]:
        return MODEL.model_dump()

    def set(self, settings: dict[str, Any], force: bool = False) -> None:
        self.calls.append(("set", settings))

    def excite(self, name: str, **plan: Any) -> dict[str, Any]:
        self.calls.append(("excite", name, plan))
        return {"experiment": 1}

    def wait(self, number: int, progress: Any) -> dict[str, Any]:
        report = self.reports.pop(0)
        if isinstance(report, BaseException):
            raise report
        return report

    def stop(self) -> None:
        self.calls.append("stop")


def done(run: str, **more: Any) -> dict[str, Any]:
    return {"state": "done", "result": {"run": run, **more}}


@contextmanager
def no_bar(label: str) -> Iterator[Any]:
    yield lambda share: None


def circle(
    monkeypatch: pytest.MonkeyPatch, daemon: FakeDaemon, results: list[GapResult]
) -> tuple[GapResult, list[str], list[str]]:
    """Result, the recordings of each look, and what was said."""
    monkeypatch.setattr("hapticd.gap.live.load_recording", lambda path, model: path.name)
    looks: list[str] = []
    said: list[str] = []

    def analyse(recordings: Sequence[Any]) -> GapResult:
        looks.append("+".join(recordings))
        return results.pop(0)

    found, _ = find_gap_live(cast(Client, daemon), MODEL, Experiment("steps", 0.1, 5.0), analyse, said.append, no_bar)
    return found, looks, said


def test_a_clear_answer_needs_one_experiment(monkeypatch: pytest.MonkeyPatch) -> None:
    daemon = FakeDaemon([done("/r/1.arrow")])
    found, looks, said = circle(monkeypatch, daemon, [result("effect_found")])
    assert (found.verdict, looks) == ("effect_found", ["1.arrow"])
    assert daemon.calls == [("excite", "steps", {"amplitude": 0.1, "duration_s": 5.0})]
    assert said == [
        "playing steps of 0.1 A for 5 s",
        "recorded /r/1.arrow",
        "searching for what the model lacks",
        "It is effect_found.",
    ]


def test_a_tie_is_followed_by_the_designed_experiment_and_a_look_at_both(monkeypatch: pytest.MonkeyPatch) -> None:
    daemon = FakeDaemon([done("/r/1.arrow"), done("/r/2.arrow")])
    found, looks, said = circle(monkeypatch, daemon, [result("ambiguous", AMBIGUOUS), result("effect_found")])
    assert (found.verdict, looks) == ("effect_found", ["1.arrow", "1.arrow+2.arrow"])
    assert daemon.calls[1:] == [
        ("set", {"encoder.decimation": 1}),
        ("excite", "release", {"amplitude": 0.3, "duration_s": 4.0}),
        ("set", {"encoder.decimation": MODEL.encoder.decimation}),
    ]
    assert "playing release of 0.3 rad for 4 s with encoder.decimation = 1" in said


def test_a_tie_that_no_experiment_breaks_ends_there(monkeypatch: pytest.MonkeyPatch) -> None:
    found, looks, _ = circle(
        monkeypatch, FakeDaemon([done("/r/1.arrow")]), [result("ambiguous", {**AMBIGUOUS, "experiment": None})]
    )
    assert (found.verdict, looks) == ("ambiguous", ["1.arrow"])


def test_an_interruption_stops_the_shaft_and_takes_settings_back(monkeypatch: pytest.MonkeyPatch) -> None:
    daemon = FakeDaemon([done("/r/1.arrow"), KeyboardInterrupt()])
    with pytest.raises(KeyboardInterrupt):
        circle(monkeypatch, daemon, [result("ambiguous", AMBIGUOUS)])
    assert daemon.calls[-2:] == ["stop", ("set", {"encoder.decimation": MODEL.encoder.decimation})]


@pytest.mark.parametrize(
    ("report", "why"),
    [
        (done("/r/1.arrow", fault="over_speed"), "the fault over_speed"),
        ({"state": "aborted", "result": {"run": "/r/1.arrow"}}, "being stopped"),
    ],
)
def test_an_experiment_that_ends_early_is_no_data(
    monkeypatch: pytest.MonkeyPatch, report: dict[str, Any], why: str
) -> None:
    with pytest.raises(LiveError, match=f"steps ended early on {why}; its recording is /r/1.arrow"):
        circle(monkeypatch, FakeDaemon([report]), [])
