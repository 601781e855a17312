"""The servo thread: a Python thread that runs the compiled loop until it ends."""

from __future__ import annotations

import math
import threading
import time
from typing import TYPE_CHECKING

from drivers.null import NullDriver
from hapticd.servo import atomics, layout
from hapticd.servo.core import ServoCore
from hapticd.servo.realtime import (
    CpuLatencyRequest,
    Grant,
    RealtimeError,
    block_signals,
    lock_memory,
    name_thread,
    set_affinity,
    set_scheduler,
    unlock_memory,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from drivers.interface import Driver
    from hapticd.config import Config
    from hapticd.record.flight import FlightRing

_WARM_UP_TICKS = 64
_TICKS_TO_SEE = 2
_FIRST_TICK_AFTER_NS = 20_000_000
_HOLD_S = 30.0
_LEAST_RING_ROWS = 1 << 18
"""13 s at the highest rate, which a live setting may choose."""


def ring_rows(rate_hz: float) -> int:
    """Rows of the ring, a power of two: 30 s at this rate, for a disk that does not answer."""
    return int(max(_LEAST_RING_ROWS, 1 << math.ceil(math.log2(_HOLD_S * rate_hz))))


class ServoThread:
    """Runs one :class:`ServoCore` against the monotonic clock.

    Args:
        config: for priority, CPU and ``require_realtime``.
        driver: an open driver.
        params: first parameter set.
        latched_fault: fault number from before a restart, or 0.
        flight: as for :class:`ServoCore`.
        words: as for :class:`ServoCore`. estops_obeyed, i2t: as for :meth:`ServoCore.begin`.
    """

    def __init__(
        self,
        config: Config,
        driver: Driver,
        params: np.void,
        latched_fault: int = 0,
        flight: FlightRing | None = None,
        words: NDArray[np.int64] | None = None,
        estops_obeyed: int = 0,
        i2t: float = 0.0,
    ) -> None:
        self.core = ServoCore(driver, ring_rows=ring_rows(config.servo.rate_hz), flight=flight, words=words)
        self._estops_obeyed, self._i2t = estops_obeyed, i2t
        self.grants: list[Grant] = []
        self._config = config
        self._params = params
        self._latched_fault = latched_fault
        self._cpu_latency = CpuLatencyRequest()
        self._granted = threading.Event()
        self._woke_at: int | None = None
        self._thread = threading.Thread(target=self._body, name="hapticd-servo", daemon=True)

    def start(self) -> None:
        """Warm up, request real time, start the loop. It begins in ``off``, or in ``fault`` if one is latched.

        Raises:
            RealtimeError: ``servo.require_realtime`` is set and something was refused.
        """
        _warm_up(self._config, self._params)
        self.core.publish(self._params)
        self.grants = [lock_memory(), self._cpu_latency.acquire()]
        self.beat()
        mode = layout.FAULT if self._latched_fault else layout.OFF
        self.core.begin(time.monotonic_ns() + _FIRST_TICK_AFTER_NS, mode, self._estops_obeyed, self._i2t)
        if self._latched_fault:
            self.core.store(atomics.FAULT_CODE, self._latched_fault)
        self._thread.start()
        self._granted.wait()
        refused = [grant for grant in self.grants if not grant.granted]
        if refused and self._config.servo.require_realtime:
            self.stop()
            reasons = "; ".join(f"{grant.name}: {grant.detail} ({grant.fix})" for grant in refused)
            raise RealtimeError(f"servo.require_realtime is true, but {reasons}")

    def beat(self) -> None:
        """Send the supervisor's heartbeat; without it the loop raises a fault after ``safety.heartbeat_timeout_s``.

        If the whole process was frozen, either thread may wake first. So after such a silence the first heartbeat waits
        until
        the loop has seen the silence: for the rest of a tick and a whole one.
        """
        now_ns, ticks = time.monotonic_ns(), self.core.load(atomics.TICKS)
        limit_ns = float(self.core.params["heartbeat_ns"])
        if self.alive() and 0.0 < limit_ns < now_ns - self.core.load(atomics.HEARTBEAT_NS):
            if self._woke_at is None:
                self._woke_at = ticks
            if ticks < self._woke_at + _TICKS_TO_SEE:
                return
        self._woke_at = None
        self.core.store(atomics.HEARTBEAT_NS, now_ns)

    def alive(self) -> bool:
        """Whether the thread still runs."""
        return self._thread.is_alive()

    def stop(self, timeout_s: float = 5.0) -> bool:
        """Command zero current, end the loop and wait for it; False if it did not end in time."""
        self.core.store(atomics.STOP, 1)
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        self._cpu_latency.release()
        unlock_memory()
        return not self._thread.is_alive()

    def _body(self) -> None:
        try:
            name_thread("hapticd-servo")
            block_signals()
            servo = self._config.servo
            affinity = set_affinity(servo.cpu)
            self.grants += [grant for grant in (set_scheduler(servo.priority), affinity) if grant is not None]
        finally:
            self._granted.set()
        self.core.run(real_time=True)


def _warm_up(config: Config, params: np.void) -> None:
    """Run the loop on a driver without function: every page of its code is loaded before a deadline counts."""
    driver = NullDriver(config)
    driver.open()
    core = ServoCore(driver, ring_rows=_WARM_UP_TICKS, excitation_rows=1)
    warm = params.copy()
    warm["request"] = layout.RUNNING
    core.publish(warm)
    core.begin(0)
    core.run(real_time=False, ticks=_WARM_UP_TICKS)
