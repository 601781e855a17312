"""A fault from its first tick to its clearing: noticed in the loop, latched on disk, then logged, its history recorded.

The latch comes first and waits for nothing: not for the log, not for a thread, not for a descriptor. What cannot be latched
is tried again for as long as the fault is there. The manager has a lock of its own, so the supervisor notices a fault even
while a command holds the daemon's lock.
"""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections import Counter
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from hapticd.config import config_digest
from hapticd.control.endpoints import JsonDict
from hapticd.record import RecordingError
from hapticd.service.background import Background
from hapticd.service.latch import CIRCUMSTANCES
from hapticd.service.refusals import Refused
from hapticd.servo import atomics, faults, layout, run_away

if TYPE_CHECKING:
    from collections.abc import Callable

    from hapticd.service.latch import FaultLatch
    from hapticd.service.rendering import Rendering
    from hapticd.service.rig import Rig

log = logging.getLogger(__name__)

_AGAIN_S = 1.0
"""Between two attempts to latch a fault."""


class FaultManager:
    """Keeps the daemon's fault.

    Args:
        latch: the fault that survives a restart.
        rendering: the rig in force, and the recording of its run, which ends with a fault.
        source: gives the name of the configuration in force.

    Attributes:
        lock: held for as long as fault and rig must agree.
        counts: how often each code was latched since the daemon began.
        not_latched: why the fault would not outlive a restart; None where it would, or there is none.

    Raises:
        RuntimeError: the system gives no thread.
    """

    def __init__(self, latch: FaultLatch, rendering: Rendering, source: Callable[[], str]) -> None:
        self.lock = threading.RLock()
        self.counts: Counter[str] = Counter()
        self._latch, self._rendering, self._source = latch, rendering, source
        self._fault = latch.load()
        self._raised_on: Rig | None = None
        self.not_latched: str | None = None
        self._tried_s = -math.inf
        self._history = Background("hapticd-history")
        self._prepare()

    def active(self) -> JsonDict | None:
        """The fault that the loop is in, as `hapticd.control.schemas.Fault`; None when it is in none."""
        if self._rendering.rig.state != layout.FAULT:
            return None
        latched = self._fault
        fault = latched or self._described()
        return {
            **{key: fault[key] for key in ("code", "cause", "help")},
            "remedy": self._remedy(fault["code"]),
            **{key: fault.get(key) for key in CIRCUMSTANCES},
            "not_latched": self.not_latched,
            "from_before": latched is not None and self._raised_on is None,
        }

    def is_latched(self) -> bool:
        """Whether the fault that the loop is in has been described and stored."""
        return self._fault is not None

    def _remedy(self, code: str) -> str:
        """What a person does about it, with this rig as it is now."""
        rig = self._rendering.rig
        if rig.device_lost:
            return faults.REOPENS if rig.config.driver.reconnect else faults.REPLUG
        if faults.NUMBERS[code] == faults.DRIVER_LOST or not (rig.position_known or self._raised_on is rig):
            return faults.REOPENED
        return faults.KINDS[faults.NUMBERS[code]].remedy

    def refuse(self) -> None:
        """Refuse while a fault is latched, or the enable input that a person must hold is released.

        Raises:
            Refused: with the cause.
        """
        if fault := self.active():
            raise Refused("fault", f"a fault is latched ({fault['code']}: {fault['cause']}); {fault['remedy']}")
        rig = self._rendering.rig
        if rig.config.safety.enable and rig.wait_ticks(1) and not rig.held:
            raise Refused("released", "the enable input is released (safety.enable): hold it, and start again")

    def refuse_new(self) -> None:
        """Latch a fault that has just been raised, and refuse with it."""
        self.latch_raised()
        self.refuse()

    def latch_raised(self) -> None:
        """Latch a new fault on disk, log it once, record the 10 s before it; try again what could not be latched."""
        with self.lock:
            if self._fault is not None and self.not_latched and time.monotonic() - self._tried_s > _AGAIN_S:
                self._store(self._fault)
            if self._rendering.rig.state == layout.FAULT and self._fault is None and self._rendering.rig.fault_number:
                self.latch(self._described())

    def latch(self, fault: JsonDict) -> None:
        """The same for a fault that the loop did not raise itself."""
        rig = self._rendering.rig
        fault = {
            **fault,
            "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "config": self._source(),
            "config_digest": config_digest(rig.config),
        }
        self._fault, self._raised_on = fault, rig
        self.counts[fault["code"]] += 1
        self._store(fault)
        fields = {"fault": fault["code"], "cause": fault["cause"], "help": fault["help"]}
        remedy = self._remedy(fault["code"])
        log.error(
            "fault %s: %s; %s (%s)", fault["code"], fault["cause"], remedy, fault["help"], extra={"journal": fields}
        )
        if self.not_latched:
            log.error("%s", self.not_latched)
        # Off the supervisor's thread, which must go on beating while the disk works.
        self._history.ask(lambda: self._keep_past(fault["code"]))

    def _store(self, fault: JsonDict) -> None:
        self._tried_s = time.monotonic()
        try:
            self._latch.store(fault)
        except OSError as error:
            self.not_latched = f"the fault would not outlive a restart: {self._latch.path}: {error.strerror}"
        else:
            self.not_latched = None
            self._history.ask(self._prepare)

    def _prepare(self) -> None:
        """Make the latch ready for the next fault; one that cannot be is made ready when it comes."""
        with self.lock, contextlib.suppress(OSError):
            self._latch.prepare()

    def alive(self) -> dict[str, bool]:
        """Name of its thread, and whether it still runs."""
        return {"hapticd-history": self._history.alive()}

    def close(self) -> None:
        """Give up what the latch had prepared."""
        self._history.end(1.0)
        with self.lock:
            self._latch.close()

    def confirm_cleared(self, before: int) -> None:
        """The loop was asked to clear: forget the fault, unless it is there again.

        Args:
            before: number of the fault that was to be cleared.

        Raises:
            Refused: it, or another one, is there.
        """
        with self.lock:
            if self._rendering.rig.state == layout.FAULT:
                # It may be another one by now.
                self._fault = None
                self.latch_raised()
                found = self.active()
                why = f"{found['cause']}; {found['remedy']}" if found else faults.KINDS[before].code
                raise Refused("fault_persists", f"the fault is still there: {why}")
            self._fault = self.not_latched = None
            self._latch.remove()

    def servo_died(self) -> None:
        """The servo thread has ended by itself: close the driver, and say so in the loop's place."""
        rig = self._rendering.rig
        if rig.servo.alive() or rig.state == layout.FAULT:
            return
        log.critical("the servo thread has ended by itself; closing the driver")
        rig.driver.close()
        with self.lock:
            # The loop is gone, so its atomics are ours to write.
            rig.core.store(atomics.FAULT_CODE, faults.DRIVER_ERROR)
            rig.core.store(atomics.MODE, layout.FAULT)
            detail = "the servo thread ended by itself; restart the daemon"
            self.latch(faults.describe(faults.DRIVER_ERROR, -1, 0, is_linear=False, detail=detail))

    def _described(self) -> JsonDict:
        rig = self._rendering.rig
        number = rig.fault_number or faults.ESTOP
        value, limit = rig.core.fault_numbers
        why = rig.driver.error or run_away.detail(number, rig.core, rig.origin_counts)
        return faults.describe(number, value, limit, is_linear=rig.config.is_linear, detail=why)

    def _keep_past(self, code: str) -> None:
        time.sleep(0.1)
        try:
            path = self._rendering.rig.recorder.dump_past(code)
            log.info("the 10 s before the fault are in %s", path)
        except RecordingError as error:
            log.error("the 10 s before the fault could not be kept: %s", error)
        finally:
            self._rendering.end_recording()
