"""The cost of one tick without input and output: the compiled loop in virtual time on the driver that does nothing.

Blocks of all variants alternate, so that a change of the processor's clock meets all of them; the figure is the median
block. Virtual time leaves out the sleep and the clock readings, which ``lateness`` shows as the time a tick runs.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

from benchmarks.report import BenchmarkError, Figure, progress, run_alone
from drivers.null import NullDriver
from hapticd.config import parse_config
from hapticd.servo import atomics
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters

GOAL_NS = 1000.0
BLOCK = 1 << 15
PLAIN = "one tick"
_SINE = {"target": "position", "waveform": "sine", "amplitude": 0.5, "frequency_hz": 90.0}
_UNIFORM = {"target": "current", "waveform": "uniform", "amplitude": 0.01}
_DELAY = {"computation_s": 0.00125}
VARIANTS: dict[str, dict[str, Any]] = {
    PLAIN: {},
    "with sine dither": {"dither": _SINE},
    "with uniform dither": {"dither": _UNIFORM},
    "with a delay of 1¼ periods": {"delay": _DELAY},
    "with sine dither and delay": {"dither": _SINE, "delay": _DELAY},
    "with DAC off": {"amplifier": {"dac_bits": 0}},
}


class Case:
    """One variant's loop, kept warm between its blocks; ``clock`` gives ns."""

    def __init__(self, changes: dict[str, Any], clock: Callable[[], int] = time.perf_counter_ns) -> None:
        self._clock = clock
        config = parse_config(changes, "benchmark")
        driver = NullDriver(config)
        driver.open()
        self._core = ServoCore(driver, ring_rows=BLOCK, excitation_rows=1)
        self._core.publish(parameters(config, Request(state=w.RUNNING)))
        self._core.begin(0, w.RUNNING)
        self.block_ns()
        self.costs_ns: list[float] = []

    def block_ns(self) -> float:
        """ns a tick of one block; every row finds room in the ring."""
        self._core.drain()
        begin = self._clock()
        self._core.run(real_time=False, ticks=BLOCK)
        spent = self._clock() - begin
        if self._core.load(atomics.MODE) != w.RUNNING or self._core.dropped():
            raise BenchmarkError("the loop did not render every tick that was timed, or found no room for its row")
        return spent / BLOCK


def measure(quick: bool) -> list[Figure]:
    """Median cost of a tick for each variant."""
    cases = {name: Case(changes) for name, changes in VARIANTS.items()}
    blocks = 20 if quick else 200
    for _ in range(blocks):
        for case in cases.values():
            case.costs_ns.append(case.block_ns())
    progress(f"{blocks} blocks of {BLOCK} ticks for each of {len(cases)} variants")
    figures = []
    for name, case in cases.items():
        details = {"fastest_block_ns": min(case.costs_ns), "slowest_block_ns": max(case.costs_ns), "blocks": blocks}
        goal = GOAL_NS if name == PLAIN else None
        figures.append(Figure(name, statistics.median(case.costs_ns), "ns", goal, details=details))
    return figures


def main(argv: list[str] | None = None) -> int:
    """Run this benchmark alone."""
    return run_alone("tick", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
