"""Lateness of the servo loop on this machine, with the configured driver, and its effect on the largest stiffness.

A late tick holds the last force for longer. So the measured lateness is part of the delay in the criterion (19): T_D
increases by the execution time and by the spread of the lateness, both at p99.9, and the largest stiffness decreases.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import drivers
from hapticd.servo import atomics
from hapticd.servo.core import Request, parameters
from hapticd.servo.pace import MARGIN, used_fraction, verdict
from hapticd.servo.thread import ServoThread
from hapticd.servo.timing import bucket_edges
from hapticd.stability.numbers import loop_from_config
from hapticd.stability.tuning import stiffness_max_passive

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from hapticd.config import Config

RATES_HZ: Final = (200.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0)
_BEAT_S: Final = 0.05


@dataclass(frozen=True)
class RateResult:
    """One rate."""

    rate_hz: float
    timing: dict[str, Any]
    """``ticks``, ``missed``, ``wake_us`` and ``exec_us`` with p50, p99, p999 and max."""
    exchanges_missed: int
    histogram: NDArray[np.int64]
    """Lateness, buckets of :func:`hapticd.servo.timing.bucket_edges`."""
    tau_d: float
    """τ_D as declared."""
    tau_d_effective: float
    """τ_D with the measured times."""
    stiffness_max: float
    """Largest stiffness that is passive at any speed, with the declared delay, N m/rad or N/m."""
    stiffness_max_effective: float
    """The same with the measured times."""

    @property
    def used(self) -> float | None:
        """Lateness and execution time at p99.9, as a share of the period."""
        return used_fraction(self.timing, self.rate_hz)

    @property
    def verdict(self) -> str:
        """Whether the loop kept up, and why, in words."""
        return verdict({**self.timing, "exchanges_missed": self.exchanges_missed}, self.rate_hz)

    @property
    def holds(self) -> bool:
        """Whether no period and no exchange was missed, with a margin."""
        return (
            self.timing["missed"] == 0 and self.exchanges_missed == 0 and self.used is not None and self.used <= MARGIN
        )


@dataclass(frozen=True)
class LatencyResult:
    """All rates."""

    driver: str
    declared_s: float
    rates: tuple[RateResult, ...]
    """In ascending order of the rate."""
    refused: dict[float, str]
    """Rates that the driver does not support, and why."""
    grants: tuple[str, ...]
    """Real-time features that were refused, in words."""

    @property
    def highest_hz(self) -> float | None:
        """The highest rate that holds, as do all lower ones; None if the lowest does not."""
        held = [rate.rate_hz for rate in itertools.takewhile(lambda rate: rate.holds, self.rates)]
        return held[-1] if held else None


def measure(
    config: Config,
    rates_hz: Collection[float],
    seconds: float,
    progress: Callable[[float], None],
) -> LatencyResult:
    """Run the loop at each rate, amplifier off, on the configured driver.

    Args:
        config: for driver, priority and CPU.
        rates_hz: rates to try. seconds: duration of each.
        progress: called with the fraction done.

    Raises:
        DriverError: the device cannot be opened.
        RealtimeError: real-time scheduling is required, and the system refuses it.
    """
    results: list[RateResult] = []
    refused: dict[float, str] = {}
    servo: ServoThread | None = None
    declared = 0.0
    for index, rate in enumerate(sorted(rates_hz)):
        trial = config.model_copy(update={"servo": config.servo.model_copy(update={"rate_hz": rate})})
        driver = drivers.create(trial)
        try:
            driver.open()
            declared = driver.latency_s
            servo = ServoThread(trial, driver, parameters(trial, Request()))
            _run(servo, seconds, progress, index / len(rates_hz), 1.0 / len(rates_hz))
            results.append(_result(trial, servo, declared))
        except drivers.DriverConfigError as error:
            refused[rate] = str(error)
        finally:
            driver.close()
    progress(1.0)
    grants = servo.grants if servo else []
    lacking = tuple(f"{grant.name}: {grant.detail}" for grant in grants if not grant.granted)
    return LatencyResult(config.driver.name, declared, tuple(results), refused, lacking)


def _run(servo: ServoThread, seconds: float, progress: Callable[[float], None], before: float, share: float) -> None:
    servo.start()
    try:
        begin = time.monotonic()
        while (elapsed := time.monotonic() - begin) < seconds and servo.alive():
            servo.beat()
            servo.core.drain()
            progress(before + share * elapsed / seconds)
            time.sleep(_BEAT_S)
    finally:
        servo.stop()


def _result(config: Config, servo: ServoThread, declared: float) -> RateResult:
    timing = servo.core.timing()
    wake, execution = timing["wake_us"], timing["exec_us"]
    extra = 0.0
    if wake["p999"] is not None:
        extra = (execution["p999"] + wake["p999"] - wake["p50"]) * 1e-6
    ideal, real = loop_from_config(config, declared), loop_from_config(config, declared + extra)
    return RateResult(
        config.servo.rate_hz,
        timing,
        servo.core.load(atomics.MISSED_EXCHANGES),
        servo.core.late_histogram.copy(),
        ideal.numbers.tau_d,
        real.numbers.tau_d,
        stiffness_max_passive(ideal),
        stiffness_max_passive(real),
    )


def write_figure(result: LatencyResult, path: Path) -> None:
    """Plot the share of ticks later than a given time, one curve per rate; the file's extension selects the format.

    Raises:
        ValueError: matplotlib does not know the extension.
    """
    from hapticd.figures.files import save_figure
    from hapticd.figures.style import new_figure, style

    with style():
        figure = new_figure(8.0, 4.4)
        axis = figure.subplots()
        edges = bucket_edges()[1:] * 1e-3
        for rate in result.rates:
            total = rate.histogram.sum()
            if total == 0:
                continue
            later = 1.0 - np.cumsum(rate.histogram) / total
            shown = later > 0
            (line,) = axis.plot(edges[shown], later[shown], lw=1.3, label=f"{rate.rate_hz:g} Hz")
            axis.axvline(1e6 / rate.rate_hz, color=line.get_color(), lw=0.8, ls=":")
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("late by more than, µs (dotted: the period)")
        axis.set_ylabel("share of the ticks")
        axis.set_title(f"Lateness of the servo loop, driver {result.driver}")
        axis.legend()
        save_figure(figure, path, dpi=150)
