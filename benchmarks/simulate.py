"""How many ticks a second ``simulate`` makes on one core: the cases of Fig. 8, and a long run that never rests.

The peer is the same tick in plain Python (:mod:`benchmarks.plain_python`), run just before and after in a process of its
own; that both end at the same place is shown as well. The peer does less: it has no safety gate, amplifier delay, parameter
mailbox or outcome, so the ratio is a lower bound.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

from benchmarks.report import BenchmarkError, Figure, progress
from hapticd.config import Config, parse_config
from hapticd.servo.simulate import simulate

GOAL = 3.0
GOAL_WITHOUT_ENERGIES = 12.0
_IDEAL = {"bandwidth_hz": 0, "dac_bits": 0}


@dataclass(frozen=True)
class _Case:
    """One release of Fig. 8: servo rate, decimation, deflection in coarse ticks, length in s."""

    rate_hz: float
    decimation: int
    deflection: float
    duration_s: float

    def config(self) -> Config:
        """The testbed with an ideal amplifier."""
        changes: dict[str, Any] = {"servo": {"rate_hz": self.rate_hz}, "encoder": {"decimation": self.decimation}}
        return parse_config({**changes, "amplifier": _IDEAL}, "benchmark")


CASES = {
    "a": _Case(1000, 217, 20.3, 1.0),
    "b": _Case(1000, 2172, 3.3, 20.0),
    "c": _Case(100, 217, 2.3, 10.0),
    "d": _Case(100, 217, 10.3, 10.0),
}


def _million_ticks_per_s(case: _Case, ticks: int, energies: bool = True) -> tuple[float, dict[str, Any]]:
    """Runs of one case, again and again until so many ticks are done: million ticks a second, and the last report."""
    config, done, spent = case.config(), 0, 0.0
    while True:
        report = simulate(config, case.duration_s, deflection=case.deflection, energies=energies)
        done += report["ticks"]
        spent += report["ticks"] / report["ticks_per_s"]
        if done >= ticks:
            return done / spent / 1e6, report


def _plain_python(ticks: int) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.plain_python", str(ticks)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchmarkError(f"the loop in plain Python failed: {done.stderr}")
    found: dict[str, float] = json.loads(done.stdout)
    return found


def measure(quick: bool) -> list[Figure]:
    """Million ticks a second, and the ratio to plain Python."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core, and so is what numba or numpy may start
    ticks = 100_000 if quick else 1_000_000
    long = _Case(1000, 2172, 3.3, ticks / 100)
    _million_ticks_per_s(CASES["a"], 1)
    before = _plain_python(ticks // 10)
    figures, ends = [], {}
    for name, case in CASES.items():
        speed, report = _million_ticks_per_s(case, ticks)
        ends[name] = report["final"]["position_ticks"]
        progress(f"case {name}: {speed:.2f} million ticks/s, {report['outcome']} in {report['ticks']} ticks a run")
        details = {"outcome": report["outcome"], "ticks_a_run": report["ticks"]}
        figures.append(Figure(f"Fig. 8 case {name}, short runs", speed, "M/s", details=details))
    speeds, bare = [], []
    for _ in range(3):
        speeds.append(_million_ticks_per_s(long, 1)[0])
        bare.append(_million_ticks_per_s(long, 1, energies=False)[0])
    after = _plain_python(ticks // 10)
    speed = statistics.median(speeds)
    python = (before["ticks_per_s"] + after["ticks_per_s"]) / 2e6
    details = {"runs": speeds, "plain_python_million_ticks_per_s": python}
    title = f"case b for {ticks * 10:.0e} ticks"
    apart = abs(ends["a"] - before["position_ticks"])
    return [
        Figure(title, speed, "M/s", GOAL, "≥", details=details),
        Figure(
            "the same without energies",
            statistics.median(bare),
            "M/s",
            GOAL_WITHOUT_ENERGIES,
            "≥",
            details={"runs": bare},
        ),
        *figures,
        Figure(
            "case a, short runs, over its peer", figures[0].value / python, "×", peer="plain Python", details=details
        ),
        Figure("final positions of the two apart", apart, "tick", 1e-9, peer="plain Python"),
    ]
