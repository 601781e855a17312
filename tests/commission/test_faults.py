"""Each seeded fault is found at its step, on the simulated RE35 in virtual time; and what becomes of the steps after it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.commission import BENCH, FAULTS, Seeded, first_failure, good, rig_of, seeded
from drivers.loopback import LoopbackDriver
from hapticd.commission import run
from hapticd.commission.bench import Bench, Sample, constant, opened
from hapticd.commission.certificate import certificate
from hapticd.commission.page import write_page
from hapticd.commission.step import Result, StepError
from hapticd.config import parse_config


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_found_at_its_step(fault: Seeded, tmp_path: Path) -> None:
    with seeded(fault, tmp_path) as rig:
        results = run.commission(rig, only=BENCH)
    assert first_failure(results) == fault.step
    found = results[fault.step]
    assert found.cause
    assert found.remedy
    assert found.figures


@pytest.mark.parametrize("seed", range(3))
def test_a_good_rig_passes(seed: int, tmp_path: Path) -> None:
    with good(seed, tmp_path, virtual=True) as rig:
        results = run.commission(rig, only=BENCH)
    assert {name: result.finding for name, result in results.items() if result.result != "pass"} == {}
    assert set(results) == set(BENCH)


@pytest.mark.parametrize("wiring", [{"current_gain": -1}, {"current_gain": 10}], ids=str)
def test_nothing_moves_after_what_is_dangerous(wiring: dict[str, Any], tmp_path: Path) -> None:
    with seeded(Seeded("", "sign", wiring=wiring), tmp_path) as rig:
        results = run.commission(rig)
    after = list(results)[list(results).index("sign") + 1 :]
    assert after
    assert all(results[name].result == "skipped" for name in after)
    assert "nothing moves after what sign found" in results["estop"].finding
    document = certificate(rig)
    assert not document["passed"]
    assert document["failed"] == ["sign"]
    assert {step["name"] for step in document["steps"] if step["skipped"]} == set(after)


def test_a_shaft_under_ten_times_the_current_is_stopped_within_a_tenth_of_a_turn(tmp_path: Path) -> None:
    with seeded(Seeded("", "sign", wiring={"current_gain": 10}), tmp_path) as rig:
        results = run.commission(rig, only=BENCH)
    assert abs(results["sign"].figures["counts"]) < 819
    assert results["sign"].figures["ratio"] > 3


def test_what_a_driver_does_not_report_is_skipped_and_said(tmp_path: Path) -> None:
    config = parse_config({}, "no watchdog")
    with rig_of(config, config, {}, tmp_path, virtual=True) as rig:
        data = rig.config.model_dump()
        del data["driver"]["watchdog_ms"]
        rig.config = parse_config(data, "no watchdog")
        results = run.commission(rig, only=BENCH)
    assert results["watchdog"].result == "skipped"
    assert "declares no watchdog" in results["watchdog"].finding


def test_a_later_call_goes_on_and_another_config_begins_anew(tmp_path: Path) -> None:
    first = ("doctor", "zero_current", "by_hand")
    config = parse_config({}, "RE35")
    with rig_of(config, config, {}, tmp_path, virtual=True) as rig:
        run.commission(rig, only=first)
        spent = rig.seconds
    did: list[str] = []
    with rig_of(config, config, {}, tmp_path, virtual=True) as rig:
        rig.say = did.append
        results = run.commission(rig, only=("sign",))
    assert [text.split()[0] for text in did] == ["4/15"]
    assert set(results) == {*first, "sign"}
    assert rig.seconds > spent
    with rig_of(config, config, {}, tmp_path, virtual=True) as rig:
        did.clear()
        rig.say = did.append
        run.commission(rig, only=first, again=("zero_current",))
    with rig_of(parse_config({"spring": {"stiffness": 0.011}}, "other"), config, {}, tmp_path, virtual=True) as rig:
        did.clear()
        rig.say = did.append
        results = run.commission(rig, only=first)
    assert "all steps begin anew" in did[0]
    assert set(results) == set(first)


def test_an_interrupted_step_leaves_zero_current_and_the_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = parse_config({}, "RE35")
    with rig_of(config, config, {}, tmp_path, virtual=True) as rig:
        run.commission(rig, only=("doctor", "zero_current", "by_hand"))
        commands: list[tuple[float, int]] = []
        send = Bench.send

        monkeypatch.setattr(Bench, "limited", _interrupted_by(8))

        def sends(bench: Bench, current: float, enable: int) -> None:
            commands.append((current, enable))
            send(bench, current, enable)

        monkeypatch.setattr(Bench, "send", sends)
        with pytest.raises(KeyboardInterrupt):
            run.commission(rig, only=("sign",))
        assert any(current for current, _ in commands)
        assert commands[-1] == (0.0, 0)
    with rig_of(config, config, {}, tmp_path, virtual=True) as rig:
        assert set(run.State(tmp_path, rig.config).results) == {"doctor", "zero_current", "by_hand"}


def test_a_step_that_cannot_be_finished_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = parse_config({}, "RE35")
    with rig_of(config, config, {}, tmp_path, virtual=True) as rig:

        def lost(*arguments: Any, **keywords: Any) -> Any:
            raise StepError("the device is lost")

        monkeypatch.setattr("hapticd.commission.bench.Bench.run", lost)
        results = run.commission(rig, only=BENCH)
    assert results["zero_current"].result == "fail"
    assert "the device is lost" in results["zero_current"].finding
    assert "it needs zero_current, which failed" in results["by_hand"].finding


def test_the_page_needs_nothing_else_and_escapes_what_it_quotes(tmp_path: Path) -> None:
    with seeded(FAULTS[0], tmp_path) as rig:
        run.commission(rig, only=BENCH)
        rig.results["doctor"] = Result("pass", "<script>alert(1)</script>")
        text = write_page(rig, certificate(rig), tmp_path).read_text()
    assert "<svg" in text
    assert "exchange the motor" in text
    assert "<script" not in text
    assert "http" not in text.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons", ""
    )


def _interrupted_by(nonzero: int) -> Any:
    """A `Bench.limited` under which Ctrl-C comes once so many currents have been asked for."""
    seen: list[float] = []

    def limited(bench: Bench, current: float) -> float:
        seen.extend([current] if current else [])
        if len(seen) > nonzero:
            raise KeyboardInterrupt
        return current

    return limited


def test_no_current_flows_while_the_enable_is_released() -> None:
    """Nor at the next try: released before it begins, the amplifier is not even asked to be on."""
    config = parse_config({"safety": {"enable": True}}, "rig")
    asked: list[float] = []

    with opened(config, virtual=True) as bench:
        assert isinstance(bench.driver, LoopbackDriver)

        def lets_go(sample: Sample) -> float:
            asked.append(sample.t)
            if len(asked) == 5:
                bench.driver.held = False
            return 0.1

        with pytest.raises(StepError, match="enable input is released"):
            bench.run(lets_go, 1.0)
        assert len(asked) == 5
        with pytest.raises(StepError, match="hold it"):
            bench.run(constant(0.1), 1.0)
        bench.driver.held = True
        after = bench.run(constant(0.1), 0.05)
    assert after.command.max() == 0.1
