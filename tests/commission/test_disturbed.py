"""A machine that is too busy: what it did is no finding about the rig, and what the rig does wrong is none about it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.commission import rig_of
from hapticd.commission import limits, run, steps
from hapticd.commission.bench import Bench, Trace
from hapticd.commission.certificate import certificate
from hapticd.commission.page import write_page
from hapticd.commission.rig import Rig
from hapticd.commission.step import Result, StepError
from hapticd.commission.steps import Step
from hapticd.config import parse_config

BUSY_S, CALM_S = 0.05, 0.002


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    config = parse_config({}, "RE35")
    return rig_of(config, config, {}, tmp_path, virtual=True)


def only(monkeypatch: pytest.MonkeyPatch, does: Callable[[Rig], Result]) -> None:
    """The list of steps is one step that does this."""
    step = Step("one", "One", does)
    for module in (run, steps):
        monkeypatch.setattr(module, "STEPS", (step,))
    monkeypatch.setattr("hapticd.commission.certificate.STEPS", (step,))


def machine(monkeypatch: pytest.MonkeyPatch, *late_s: float) -> None:
    """How long programs wait, one value each time that somebody asks, the last one from then on."""
    values = list(late_s)
    monkeypatch.setattr(Rig, "late_s", lambda rig, begin_ns: values.pop(0) if len(values) > 1 else values[0])


def losing(*, dangerous: bool = False, error: bool = False, exchanges: int = 3) -> Callable[[Rig], Result]:
    """A step that fails after some exchanges have failed."""

    def step(rig: Rig) -> Result:
        rig.missed += exchanges
        if error:
            raise StepError("the device did not answer")
        return Result("fail", "the motion is late", cause="a filter", remedy="none", dangerous=dangerous)

    return step


@pytest.mark.parametrize("error", [False, True])
def test_exchanges_that_a_busy_machine_lost_are_no_failure(
    error: bool, rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    only(monkeypatch, losing(error=error))
    machine(monkeypatch, BUSY_S)
    with rig:
        found = run.commission(rig)["one"]
    assert rig.missed == 3 * run.ATTEMPTS
    assert found.result == "disturbed"
    assert "too busy, 3 times" in found.finding
    assert "programs waited for 50 ms" in found.finding
    assert "end what else runs" in found.remedy
    document = certificate(rig)
    assert (document["failed"], document["disturbed"], document["passed"]) == ([], ["one"], False)
    assert "end what else runs" in write_page(rig, document, tmp_path).read_text()
    only(monkeypatch, lambda rig: Result("pass", "it does"))
    with rig:
        assert run.commission(rig)["one"].result == "pass"  # the same command tries again


@pytest.mark.parametrize(
    ("late_s", "step"),
    [
        (CALM_S, losing()),
        (CALM_S, losing(error=True)),
        (BUSY_S, losing(exchanges=0)),
        (BUSY_S, losing(dangerous=True)),
    ],
    ids=["calm", "calm, no answer", "busy, no exchange lost", "busy, and dangerous"],
)
def test_what_the_rig_does_wrong_is_a_failure_at_once(
    late_s: float, step: Callable[[Rig], Result], rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    only(monkeypatch, step)
    machine(monkeypatch, late_s)
    with rig:
        found = run.commission(rig)["one"]
    assert found.result == "fail"
    assert rig.missed <= 3


def test_a_machine_that_becomes_calm_gives_an_answer(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, losing())
    machine(monkeypatch, BUSY_S, CALM_S)
    with rig:
        found = run.commission(rig)["one"]
    assert (found.result, found.finding) == ("fail", "the motion is late")
    assert rig.missed == 6


@pytest.mark.parametrize(
    ("faults", "late_s", "result"),
    [({"watchdog": False}, BUSY_S, "fail"), ({"watchdog": False}, 0.1, "disturbed"), ({}, BUSY_S, "pass")],
    ids=["dead", "dead, and nobody could see it", "works"],
)
def test_a_watchdog_is_timed_as_well_as_the_machine_allows(
    faults: dict[str, Any], late_s: float, result: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = parse_config({}, "RE35")
    machine(monkeypatch, late_s)
    with rig_of(config, config, faults, tmp_path, virtual=True) as rig:
        found = run.commission(rig, only=("doctor", "zero_current", "by_hand", "sign", "watchdog"))
    assert found["sign"].result == "pass", found["sign"].finding
    assert found["watchdog"].result == result, found["watchdog"].finding


def test_failed_exchanges_are_counted(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(bench: Bench, *arguments: Any, **words: Any) -> Trace:
        bench.failed += 5
        raise StepError("the device did not answer")

    monkeypatch.setattr(Bench, "run", lost)
    with rig, pytest.raises(StepError), rig.bench() as bench:
        bench.run(lambda sample: 0.0, 1.0)
    assert rig.missed == 5


@pytest.mark.parametrize("code", limits.LOST)
def test_a_fault_of_the_way_to_the_device_is_not_taken_for_the_loops(code: str) -> None:
    class Daemon:
        client = property(lambda self: self)

        def status(self) -> dict[str, Any]:
            return {"fault": {"code": code, "cause": "3 exchanges failed"}}

    with pytest.raises(StepError, match=f"{code} ended the motion first: 3 exchanges failed"):
        limits.fault_of(Daemon())  # type: ignore[arg-type]


@pytest.mark.realtime
def test_the_rig_has_a_witness_of_its_own_machine(rig: Rig) -> None:
    begun_ns = time.monotonic_ns()
    with rig:
        assert rig.late_s(begun_ns) == 0.0  # nothing depends on ordinary threads in virtual time
        rig._watch()
        assert rig.late_s(begun_ns) < 1e-9 * (time.monotonic_ns() - begun_ns)


def test_missed_periods_of_a_daemon_are_counted(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fault overrun had ended a step as a failure of the rig, on a machine that was too busy."""

    class Daemon:
        client = property(lambda self: self)
        running = True

        def __init__(self, *arguments: Any, **words: Any) -> None: ...

        def __enter__(self) -> Daemon:
            return self

        def __exit__(self, *exception: object) -> None: ...

        def wait_ready(self) -> None: ...

        def status(self) -> dict[str, Any]:
            return {"fault": None, "exchanges_missed": 1, "timing": {"missed": 2}}

        def stop(self) -> dict[str, Any]:
            return {"exchanges_missed": 2, "timing": {"missed": 12}}

    monkeypatch.setattr("hapticd.commission.rig.DaemonProcess", Daemon)
    with rig, rig.daemon():
        pass
    assert rig.missed == 11
