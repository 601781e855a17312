"""A device that plays a script and writes down everything it is told: the truth in tests of the loop's way out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers import PythonDriver
from hapticd.config import Config, parse_config
from hapticd.servo import atomics, faults
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters


def config(**sections: Any) -> Config:
    """An ideal amplifier on an 8192-count encoder, at full force from the start, with whatever else a test needs."""
    base: dict[str, Any] = {"amplifier": {"bandwidth_hz": 0, "dac_bits": 0}, "safety": {"soft_start_s": 0}}
    for name, values in sections.items():
        base[name] = {**base.get(name, {}), **values}
    return parse_config(base, "test")


class Scripted(PythonDriver):
    """``counts(n)`` gives the n-th sample: a number, None for a missed exchange, or an exception to raise."""

    def __init__(self, config: Config, counts: Callable[[int], int | Exception | None] = lambda n: 0) -> None:
        super().__init__(config)
        self.script = counts
        self.samples = 0
        self.commands: list[tuple[float, bool]] = []
        self.fail_write_at: int | None = None
        self.obedient = True
        self.closed = False
        self.read_result: int | None = None
        """What ``read`` returns instead of its own word, from now on."""

    def connect(self) -> None:
        """Nothing to connect."""

    def disconnect(self) -> None:
        self.closed = True

    def read_counts(self) -> int | None:
        value = self.script(self.samples)
        self.samples += 1
        if isinstance(value, Exception):
            raise value
        return value

    def write_current(self, current: float, enable: bool) -> None:
        self.commands.append((current, enable))
        if self.fail_write_at is not None and len(self.commands) == self.fail_write_at:
            raise OSError("the cable is out")

    def _read(self, words: NDArray[np.int64]) -> int:
        result = super()._read(words)
        return result if self.read_result is None else self.read_result

    def _write(self, words: NDArray[np.int64]) -> int:
        result = super()._write(words)
        self._enabled = self._enabled and self.obedient
        return result


def core_for(driver: PythonDriver, cfg: Config, state: int = w.RUNNING, **changes: Any) -> ServoCore:
    """A core in virtual time, in ``off``, asked for ``state``."""
    driver.open()
    core = ServoCore(driver, ring_rows=1024, excitation_rows=256)
    core.publish(parameters(cfg, Request(state=state, **changes)))
    core.begin(0)
    return core


def fault_code(core: ServoCore) -> str | None:
    """Public code of the latched fault."""
    number = core.load(atomics.FAULT_CODE)
    return faults.KINDS[number].code if number else None


def rows_of(core: ServoCore, ticks: int) -> np.ndarray[Any, Any]:
    """Run that many ticks and take the rows."""
    core.run(real_time=False, ticks=ticks)
    return core.drain()


class Slow(Scripted):
    """A driver with a declared latency; tests load it by its name, as an entry point."""

    latency_s = 0.01
