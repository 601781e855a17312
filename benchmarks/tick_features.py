"""What damping, the passivity observer and its controller add to a tick: ratios to the plain one, on a moving shaft."""

from __future__ import annotations

import statistics
import sys
import time
from typing import Any

import numpy as np
from numba import types

from benchmarks.report import BenchmarkError, Figure, progress, run_alone
from drivers.interface import EXCHANGE_WORDS, STATUS_ENABLED, X_COUNTS, X_CURRENT_MEASURED, X_STATUS, X_TICK
from drivers.null import NullDriver
from hapticd.config import parse_config
from hapticd.jit import carray, cfunc
from hapticd.servo import atomics
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters

GOAL = 1.3
BLOCK = 1 << 15
_SIGNATURE = types.int32(types.CPointer(types.int64), types.CPointer(types.int64))
_DAMPING = {"damping": 1e-5}
_LOW_PASS = {"damping": 1e-5, "velocity_estimate": "low_pass"}
VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "with damping": {"spring": _DAMPING},
    "with low-pass damping": {"spring": _LOW_PASS},
    "with the observer": {"safety": {"passivity": "observe"}},
    "with the controller": {"safety": {"passivity": "control"}},
    "with the controller and damping": {"safety": {"passivity": "control"}, "spring": _DAMPING},
}


@cfunc(_SIGNATURE)
def _read_moving(state: int, exchange: int) -> int:
    """A shaft that goes to and fro, a few counts a tick: every tick books energy, and the controller has work."""
    words = carray(exchange, (EXCHANGE_WORDS,))
    phase = words[X_TICK] & 255
    words[X_COUNTS] = 7 * (phase if phase < 128 else 256 - phase)
    words.view(np.float64)[X_CURRENT_MEASURED] = np.nan
    words[X_STATUS] = STATUS_ENABLED
    return 0


class _MovingDriver(NullDriver):
    """A shaft that moves by itself."""

    def open(self) -> None:
        """Set the addresses."""
        super().open()
        self.read_address = _read_moving.address


class _Case:
    """One variant's loop, kept warm between its blocks."""

    def __init__(self, changes: dict[str, Any]) -> None:
        config = parse_config(changes, "benchmark")
        driver = _MovingDriver(config)
        driver.open()
        self._core = ServoCore(driver, ring_rows=BLOCK, excitation_rows=1)
        self._core.publish(parameters(config, Request(state=w.RUNNING)))
        self._core.begin(0, w.RUNNING)
        self.block_ns()
        if config.safety.passivity == "control" and self._core.passivity()["dissipated_J"] == 0.0:
            raise BenchmarkError("the controller had nothing to do")
        self.costs_ns: list[float] = []

    def block_ns(self) -> float:
        """ns a tick of one block; every row finds room in the ring."""
        self._core.drain()
        begin = time.perf_counter_ns()
        self._core.run(real_time=False, ticks=BLOCK)
        spent = time.perf_counter_ns() - begin
        if self._core.load(atomics.MODE) != w.RUNNING or self._core.dropped():
            raise BenchmarkError("the loop did not render every tick that was timed, or found no room for its row")
        return spent / BLOCK


def measure(quick: bool) -> list[Figure]:
    """Median over blocks of the ratio to the plain block beside it, so that a change of the processor's clock meets both."""
    cases = {name: _Case(changes) for name, changes in VARIANTS.items()}
    blocks = 20 if quick else 200
    for _ in range(blocks):
        for case in cases.values():
            case.costs_ns.append(case.block_ns())
    progress(f"{blocks} blocks of {BLOCK} ticks for each of {len(cases)} variants")
    plain = cases["plain"].costs_ns
    figures = [Figure("plain tick, moving shaft", statistics.median(plain), "ns", details={"blocks": blocks})]
    for name, case in cases.items():
        if name != "plain":
            ratio = statistics.median(a / b for a, b in zip(case.costs_ns, plain, strict=True))
            details = {"tick_ns": statistics.median(case.costs_ns), "blocks": blocks}
            figures.append(Figure(f"tick {name}", ratio, "×", GOAL, peer="plain tick", details=details))
    return figures


def main(argv: list[str] | None = None) -> int:
    """Run this benchmark alone."""
    return run_alone("tick_features", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
