"""The driver in our own hands: one exchange after the other from Python, for steps that come before any servo loop.

What a servo loop does is left out on purpose: no spring, no origin. What stays: a current beyond the peak, a shaft that goes
further than asked for, a device that answers no more, and Ctrl-C all end in zero current.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import drivers
from drivers import interface as x
from drivers.loopback import LoopbackDriver
from hapticd.commission.step import DisturbedError, StepError
from hapticd.plant import kernel
from hapticd.plant.amplifier import converter_grid, quantise_current

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config

_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)
FASTEST_HZ: Final = 1000.0
"""Python keeps no shorter period."""
PRIORITY: Final = 60
"""SCHED_FIFO, below a servo loop and a simulated device."""
_MISSED_IN_A_ROW: Final = 50
_PAUSE_S: Final = 0.01
_OFF_FIRST: Final = 2
"""Exchanges."""
_NS: Final = 1e9


@dataclass(frozen=True)
class Sample:
    """One exchange, as a rule that chooses the current sees it; what is not known yet is from the sample before."""

    t: float
    """s, since the run began."""
    travel: float
    """rad or m, since the run began, counted as ``encoder.invert`` says."""
    enabled: bool


@dataclass(frozen=True)
class Trace:
    """A run, one row an exchange; all arrays have shape (n,)."""

    t: NDArray[np.float64]
    """When the sample was asked for, s."""
    sent: NDArray[np.float64]
    """When its command was written, s; NaN where none was."""
    position: NDArray[np.float64]
    """rad or m from where the run began."""
    counts: NDArray[np.int64]
    command: NDArray[np.float64]
    measured: NDArray[np.float64]
    enabled: NDArray[np.bool_]
    index_seen: NDArray[np.int64]
    index_counts: NDArray[np.int64]
    code: int = 0
    """Return code that ended the run, 0 for none."""
    cut: bool = False
    """Whether it went further than it was allowed."""
    worst_pause: float = 0.0
    """Longest time between two exchanges, s."""

    def part(self, start: float, end: float) -> Trace:
        """The rows of a time, s."""
        kept = (self.t >= start) & (self.t < end)
        rows = {name: getattr(self, name)[kept] for name in _ARRAYS}
        return Trace(**rows, code=self.code, cut=self.cut, worst_pause=self.worst_pause)


_ARRAYS: Final = ("t", "sent", "position", "counts", "command", "measured", "enabled", "index_seen", "index_counts")
Rule = Callable[[Sample], float | None]
"""The current in A for a sample; None: say nothing at all this time."""


def constant(current: float) -> Rule:
    """A rule that always gives the same current."""
    return lambda sample: current


def in_turn(each_s: float, *currents: float | None) -> Rule:
    """A rule that gives one after the other, each for a time in s, and stays with the last."""
    return lambda sample: currents[min(int(sample.t / each_s), len(currents) - 1)]


class Bench:
    """An open driver.

    Args:
        config: the rig's. driver: open.
        virtual: the loopback's time is not that of the clock, and passes as fast as it can be computed.
    """

    def __init__(self, config: Config, driver: drivers.Driver, *, virtual: bool = False) -> None:
        self.config, self.driver = config, driver
        self.period = max(config.period, 1.0 / FASTEST_HZ)
        self.seconds = 0.0
        """How long the device has been in our hands."""
        self.failed = 0
        """Exchanges without a fresh sample."""
        self._virtual = virtual
        self._now_ns = 0
        self._words = x.new_exchange()
        self._floats = self._words.view(np.float64)
        self._floats[x.X_PERIOD_NS] = self.period * _NS
        self._read, self._write = _FUNCTION(driver.read_address), _FUNCTION(driver.write_address)
        self._sign = -1 if config.encoder.invert else 1
        self._grid = converter_grid(config.amplifier.dac_bits, config.amplifier.dac_full_scale)
        self._hand = driver.plant if isinstance(driver, LoopbackDriver) else None

    @property
    def hand_is_simulated(self) -> bool:
        """Whether we may push the shaft ourselves."""
        return self._hand is not None

    def push(self, force: float) -> None:
        """The simulated hand's force from now on, N m or N."""
        if self._hand is not None:
            self._hand[kernel.HAND_FORCE] = force

    def run(
        self,
        rule: Rule,
        seconds: float,
        *,
        travel: float | Callable[[float], float] | None = None,
        hand: Callable[[float], float] | None = None,
        until: Callable[[Sample], bool] | None = None,
        fresh: bool = True,
        may_fault: bool = False,
    ) -> Trace:
        """Exchange for a time, and leave zero current behind.

        Args:
            rule: the current. seconds: how long, at most.
            travel: how far the shaft may go, rad or m, or that as a function of the time in s; None: as far as it likes.
            hand: the simulated hand's force at a time. until: ends the run early.
            fresh: wait until the amplifier is on first; else it is taken as it is.
            may_fault: what the device does ends the run without an error.

        Raises:
            DisturbedError: it reports a fault after this machine had kept us from it. StepError: it is lost, reports a fault
                or does not enable.
        """
        if fresh:
            self._enable()
        rows: list[tuple[Any, ...]] = []
        code, cut, worst, missed = 0, False, 0.0, 0
        begun = last = self._clock()
        start = int(self._words[x.X_COUNTS]) * self._sign
        try:
            while (t := (self._clock() - begun) / _NS) < seconds:
                worst = max(worst, (self._clock() - last) / _NS)
                last = self._clock()
                if hand is not None:
                    self.push(hand(t))
                code = self._read_sample()
                counts = int(self._words[x.X_COUNTS]) * self._sign
                on = bool(self._words[x.X_STATUS] & x.STATUS_ENABLED)
                self._held()
                sample = Sample(t, (counts - start) * self.config.raw_resolution, on)
                missed = missed + 1 if code == x.MISSED else 0
                allowed = travel(t) if callable(travel) else travel
                cut = allowed is not None and abs(sample.travel) > allowed
                wanted = None if code not in (x.OK, x.MISSED) or cut else rule(sample)
                sent = np.nan
                if wanted is not None:
                    wanted = self.limited(wanted)
                    sent = (self._clock() - begun) / _NS
                    self.send(wanted, 1)
                rows.append(
                    (
                        t,
                        sent,
                        sample.travel,
                        counts,
                        wanted or 0.0,
                        float(self._floats[x.X_CURRENT_MEASURED]),
                        on,
                        int(self._words[x.X_INDEX_SEEN]),
                        int(self._words[x.X_INDEX_COUNTS]) * self._sign,
                    )
                )
                if code not in (x.OK, x.MISSED) or cut or missed > _MISSED_IN_A_ROW or (until and until(sample)):
                    break
                self._sleep(last)
        finally:
            self.send(0.0, 1)
            self.send(0.0, 1)
            if hand is not None:
                self.push(0.0)
            self.seconds += (self._clock() - begun) / _NS
        if missed > _MISSED_IN_A_ROW:
            raise StepError(f"the device did not answer {missed} times in a row")
        if code not in (x.OK, x.MISSED) and not may_fault:
            if worst > _PAUSE_S:
                raise DisturbedError(
                    f"this machine paused for {1e3 * worst:.0f} ms, and the device ended it: {self._why()}"
                )
            raise StepError(f"the device ended it: {self._why()}")
        columns: Any = dict(zip(_ARRAYS, map(np.array, zip(*rows, strict=True)), strict=True))
        return Trace(**columns, code=0 if code == x.MISSED else code, cut=cut, worst_pause=worst)

    def wait_held(self, held: bool, longest_s: float) -> float | None:
        """Exchange with the amplifier off until the enable input reads so; when, s, or None where it never did.

        A simulated hand does it at once.
        """
        if isinstance(self.driver, LoopbackDriver):
            self.driver.held = held
        begun = self._clock()
        try:
            while (t := (self._clock() - begun) / _NS) < longest_s:
                last = self._clock()
                if self._call(self._read) == x.OK and bool(self._words[x.X_STATUS] & x.STATUS_HELD) == held:
                    return t
                self.send(0.0, 0)
                self._sleep(last)
        finally:
            self.seconds += (self._clock() - begun) / _NS
        return None

    def rest(self, longest_s: float = 3.0) -> int:
        """Wait at zero current until the shaft has stood for a tenth of a second; its counts then.

        Raises:
            StepError: as `run`.
        """
        seen: list[tuple[float, float]] = []

        def still(sample: Sample) -> bool:
            seen.append((sample.t, sample.travel))
            recent = [travel for t, travel in seen if t > sample.t - 0.1]
            return sample.t > 0.15 and max(recent) - min(recent) <= self.config.raw_resolution

        return int(self.run(constant(0.0), longest_s, until=still).counts[-1])

    def off(self) -> None:
        """Zero current, then the amplifier off."""
        for enable in (1, 0, 0):
            self.send(0.0, enable)
            self._call(self._read)

    def _enable(self) -> None:
        begun, asked = self._clock(), 0
        while (self._clock() - begun) / _NS < self.config.safety.enable_timeout_s:
            last = self._clock()
            code = self._read_sample()
            if code in (x.LOST, x.ERROR):
                raise StepError(f"the device is lost: {self.driver.error or 'it does not answer any more'}")
            if code == x.OK:
                self._held()
                if self._words[x.X_STATUS] & x.STATUS_ENABLED:
                    return
            # what an earlier run made the device latch is cleared by asking for the amplifier off first
            self.send(0.0, 0 if code == x.DEVICE_FAULT or asked < _OFF_FIRST else 1)
            asked += 1
            self._sleep(last)
        limit = self.config.safety.enable_timeout_s
        raise StepError(
            f"the amplifier did not report that it is on within {limit:g} s (safety.enable_timeout_s): {self._why()}"
        )

    def _held(self) -> None:
        """No current without the enable that a person holds, where the config asks for one.

        Raises:
            StepError: it is released.
        """
        if self.config.safety.enable and not self._words[x.X_STATUS] & x.STATUS_HELD:
            raise StepError("the enable input is released (safety.enable): hold it, and run this step again")

    def _why(self) -> str:
        return self.driver.error or f"device code {int(self._words[x.X_DEVICE_CODE])}"

    def limited(self, current: float) -> float:
        """A current within ``amplifier.peak_current``, A."""
        peak = self.config.amplifier.peak_current or np.inf
        return float(min(max(current, -peak), peak))

    def send(self, current: float, enable: int) -> None:
        """Command a current, A, in steps of the converter."""
        step, largest = self._grid
        self._floats[x.X_CURRENT], self._words[x.X_CODE] = quantise_current(current, step, largest)
        self._words[x.X_ENABLE] = enable
        self._call(self._write)

    def _read_sample(self) -> int:
        code = self._call(self._read)
        self.failed += code != x.OK
        return code

    def _call(self, function: Any) -> int:
        self._words[x.X_TIME_NS] = self._clock()
        return int(function(self.driver.state_address, self._words.ctypes.data))

    def _clock(self) -> int:
        return self._now_ns if self._virtual else time.monotonic_ns()

    def _sleep(self, since_ns: int) -> None:
        if self._virtual:
            self._now_ns += round(self.period * _NS)
        else:
            time.sleep(max(0.0, self.period - (time.monotonic_ns() - since_ns) / _NS))
        self._words[x.X_TICK] += 1


@contextmanager
def opened(config: Config, *, virtual: bool = False) -> Iterator[Bench]:
    """The config's device in our hands, and at zero current and off afterwards whatever happens.

    Raises:
        DriverError: it cannot be opened.
    """
    driver = drivers.create(config)
    try:
        driver.open()
        bench = Bench(config, driver, virtual=virtual)
        with contextlib.nullcontext() if virtual else _urgent():
            try:
                yield bench
            finally:
                bench.off()
    finally:
        driver.close()


@contextmanager
def _urgent() -> Iterator[None]:
    """This thread before all ordinary ones, where that is granted, and without pauses to collect garbage."""
    before = os.sched_getscheduler(0)
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, before, os.sched_param(0))
