"""Handles a fault from its first tick to its clearing: it is latched on disk, then logged, and its history is recorded.

Latching comes first and waits for nothing: no log, no thread, no descriptor. If it fails, it is tried again as long as the
fault exists. The manager has its own lock, so the supervisor handles a fault even while a command holds the daemon's lock.
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
"""Time between two attempts to latch a fault [s]."""


class FaultManager:
    """Manages the daemon's fault.

    Args:
        latch: the fault that survives a restart.
        rendering: the present rig, and the recording of its run, which ends with a fault.
        source: returns the name of the present configuration.

    Attributes:
            lock: held while fault and rig must be consistent.
            counts: number of latched faults per code since the daemon started.
            not_latched: why the fault would be lost at a restart; None if it is on disk, or there is none.

    Raises:
            RuntimeError: a thread cannot be created.
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
        """The present fault, as `hapticd.control.schemas.Fault`; None without a fault."""
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
        """Whether the present fault is described and stored."""
        return self._fault is not None

    def _remedy(self, code: str) -> str:
        """The remedy, for the present state of the rig."""
        rig = self._rendering.rig
        if rig.device_lost:
            return faults.REOPENS if rig.config.driver.reconnect else faults.REPLUG
        if faults.NUMBERS[code] == faults.DRIVER_LOST or not (rig.position_known or self._raised_on is rig):
            return faults.REOPENED
        return faults.KINDS[faults.NUMBERS[code]].remedy

    def refuse(self) -> None:
        """Refuse while a fault is latched, or the enable input is released.

        Raises:
            Refused: with the cause.
        """
        if fault := self.active():
            raise Refused("fault", f"a fault is latched ({fault['code']}: {fault['cause']}); {fault['remedy']}")
        rig = self._rendering.rig
        if rig.config.safety.enable and rig.wait_ticks(1) and not rig.held:
            raise Refused("released", "the enable input is released (safety.enable): hold it, and start again")

    def refuse_new(self) -> None:
        """Latch a newly raised fault, and refuse because of it."""
        self.latch_raised()
        self.refuse()

    def latch_raised(self) -> None:
        """Latch a new fault on disk, log it once, record the 10 s before it; retry a failed latch."""
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
        # Not in the supervisor's thread, which must send the heartbeat while the disk is busy.
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
        """Prepare the latch for the next fault; if that fails, it is prepared when the fault occurs."""
        with self.lock, contextlib.suppress(OSError):
            self._latch.prepare()

    def alive(self) -> dict[str, bool]:
        """Name of its thread to whether it runs."""
        return {"hapticd-history": self._history.alive()}

    def close(self) -> None:
        """Close the prepared latch."""
        self._history.end(1.0)
        with self.lock:
            self._latch.close()

    def confirm_cleared(self, before: int) -> None:
        """After the loop has cleared: remove the fault, unless it is back.

        Args:
            before: number of the cleared fault.

        Raises:
            Refused: this fault, or another one, is present.
        """
        with self.lock:
            if self._rendering.rig.state == layout.FAULT:
                # It may be another fault.
                self._fault = None
                self.latch_raised()
                found = self.active()
                why = f"{found['cause']}; {found['remedy']}" if found else faults.KINDS[before].code
                raise Refused("fault_persists", f"the fault is still there: {why}")
            self._fault = self.not_latched = None
            self._latch.remove()

    def servo_died(self) -> None:
        """The servo thread has ended by itself: close the driver, and raise the fault instead of the loop."""
        rig = self._rendering.rig
        if rig.servo.alive() or rig.state == layout.FAULT:
            return
        log.critical("the servo thread has ended by itself; closing the driver")
        rig.driver.close()
        with self.lock:
            # The loop has ended, so this thread may write its atomics.
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
