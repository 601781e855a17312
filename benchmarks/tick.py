"""The cost of one tick without input and output: the compiled loop in virtual time on a driver that does nothing.

Blocks of all variants alternate, so that a change of the processor's clock meets all of them; the figure is the median
block. Virtual time leaves out the sleep and the clock readings, which ``lateness`` shows as the time a tick runs. What
damping, the passivity observer and its controller add is told as the median ratio to the plain block beside it, on a shaft
that moves.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types

from benchmarks.report import BenchmarkError, Figure, progress
from drivers.interface import EXCHANGE_WORDS, STATUS_ENABLED, X_COUNTS, X_CURRENT_MEASURED, X_STATUS, X_TICK
from drivers.null import NullDriver
from hapticd.config import parse_config
from hapticd.jit import carray, cfunc
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
RATIO_GOAL = 1.3
_SIGNATURE = types.int32(types.CPointer(types.int64), types.CPointer(types.int64))
_DAMPING = {"damping": 1e-5}
MOVING = "plain tick, moving shaft"
MOVING_VARIANTS: dict[str, dict[str, Any]] = {
    MOVING: {},
    "tick with damping": {"spring": _DAMPING},
    "tick with low-pass damping": {"spring": {**_DAMPING, "velocity_estimate": "low_pass"}},
    "tick with the observer": {"safety": {"passivity": "observe"}},
    "tick with the controller": {"safety": {"passivity": "control"}},
    "tick with the controller and damping": {"safety": {"passivity": "control"}, "spring": _DAMPING},
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


class Case:
    """One variant's loop, kept warm between its blocks; ``clock`` gives ns."""

    def __init__(
        self,
        changes: dict[str, Any],
        clock: Callable[[], int] = time.perf_counter_ns,
        driver_kind: type[NullDriver] = NullDriver,
    ) -> None:
        self._clock = clock
        config = parse_config(changes, "benchmark")
        driver = driver_kind(config)
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
        begin = self._clock()
        self._core.run(real_time=False, ticks=BLOCK)
        spent = self._clock() - begin
        if self._core.load(atomics.MODE) != w.RUNNING or self._core.dropped():
            raise BenchmarkError("the loop did not render every tick that was timed, or found no room for its row")
        return spent / BLOCK


def measure(quick: bool) -> list[Figure]:
    """Median cost of a tick for each variant."""
    cases = {name: Case(changes) for name, changes in VARIANTS.items()}
    cases |= {name: Case(changes, driver_kind=_MovingDriver) for name, changes in MOVING_VARIANTS.items()}
    blocks = 20 if quick else 200
    for _ in range(blocks):
        for case in cases.values():
            case.costs_ns.append(case.block_ns())
    progress(f"{blocks} blocks of {BLOCK} ticks for each of {len(cases)} variants")
    figures = []
    for name, case in cases.items():
        middle = statistics.median(case.costs_ns)
        details = {
            "tick_ns": middle,
            "fastest_ns": min(case.costs_ns),
            "slowest_ns": max(case.costs_ns),
            "blocks": blocks,
        }
        if name in VARIANTS or name == MOVING:
            figures.append(Figure(name, middle, "ns", GOAL_NS if name == PLAIN else None, details=details))
        else:
            ratio = statistics.median(a / b for a, b in zip(case.costs_ns, cases[MOVING].costs_ns, strict=True))
            figures.append(Figure(name, ratio, "×", RATIO_GOAL, peer=MOVING, details=details))
    return figures
