"""`hapticd latency`: what was measured goes into the delay, and a rate that does not hold is not recommended."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.cli.latency import report
from hapticd.cli.main import main
from hapticd.doctor.latency import LatencyResult, RateResult


def rate(rate_hz: float, late_us: float, missed: int = 0) -> RateResult:
    quantiles = {"p50": 1.0, "p99": late_us, "p999": late_us, "max": late_us}
    timing: dict[str, Any] = {"ticks": 1000, "missed": missed, "wake_us": quantiles, "exec_us": quantiles}
    return RateResult(rate_hz, timing, 0, np.zeros(1, np.int64), 0.0, 0.0, 1.0, 1.0)


def highest(*rates: RateResult) -> float | None:
    return LatencyResult("loopback", 0.0, rates, {}, ()).highest_hz


def test_a_rate_needs_half_a_period_to_spare() -> None:
    # 2 x 240 us at p99.9 are 48 % of a millisecond, and 96 % of half a one.
    assert highest(rate(500, 240), rate(1000, 240), rate(2000, 240)) == 1000


def test_a_missed_period_ends_it_whatever_comes_above() -> None:
    assert highest(rate(500, 10), rate(1000, 10, missed=1), rate(2000, 10)) == 500
    assert highest(rate(500, 300, missed=2)) is None


def test_the_words_say_what_decided() -> None:
    rates = (rate(500, 10), rate(1000, 10, missed=2), rate(2000, 900))
    text = report(LatencyResult("loopback", 0.0, rates, {}, ()), 1000.0, False, False)
    assert "1000 Hz: the loop does not keep up: 2 periods missed; lateness and execution take 2 % of a period" in text
    assert "2000 Hz: the loop" not in text
    assert text.splitlines()[-1].startswith(
        "The highest rate that holds, with half a period to spare at p99.9, is 500 Hz."
    )
    slow = report(LatencyResult("loopback", 0.0, (rate(1000, 300),), {}, ()), 1000.0, False, False)
    assert "1000 Hz: the loop keeps up without margin: lateness and execution take 60 % of a period" in slow


@pytest.mark.realtime
def test_the_command_measures_the_real_loop(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    figure = tmp_path / "late.svg"
    settings = ["--set", "servo.rate_hz=250", "--rate", "250", "--seconds", "0.6", "-o", str(figure)]
    code = main(["latency", *settings, "--json"])
    document = json.loads(capsys.readouterr().out)
    (found,) = document["rates"]
    assert found["ticks"] + found["missed"] == pytest.approx(150, abs=40)
    assert found["wake_us"]["p50"] > 0
    assert found["tau_d"]["measured"] > found["tau_d"]["declared"]
    assert found["stiffness_max"]["measured"] < found["stiffness_max"]["declared"]
    assert code == (0 if document["configured"]["holds"] else 1)
    assert figure.read_text().startswith("<?xml")


def test_a_rate_beyond_the_loop_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["latency", "--rate", "50000"]) == 2
    assert "between 1 and 20000 Hz" in capsys.readouterr().err
