"""The fault from its first tick to its clearing: noticed in the loop, said once, latched on disk, kept with its past.

Guarded by a lock of its own, so that the supervisor notices a fault however long a command holds the daemon's.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING

from hapticd.record import RecordingError
from hapticd.service.control import JsonDict
from hapticd.service.refusals import Refused
from hapticd.servo import atomics, faults
from hapticd.servo import layout as w

if TYPE_CHECKING:
    from hapticd.service.latch import FaultLatch
    from hapticd.service.rig import Rig

log = logging.getLogger(__name__)


class FaultManager:
    """Keeps the daemon's fault.

    Args:
        latch: the fault that survives a restart.
        rig: the rig in force.
        past_kept: called after the 10 s before a fault are on disk, or could not be.

    Attributes:
        lock: held for as long as fault and rig must agree.
        counts: how often each code was latched since the daemon began.
    """

    def __init__(self, latch: FaultLatch, rig: Callable[[], Rig], past_kept: Callable[[], None]) -> None:
        self.lock = threading.RLock()
        self.counts: Counter[str] = Counter()
        self._latch, self._rig, self._past_kept = latch, rig, past_kept
        self._fault = latch.load()

    @property
    def number(self) -> int:
        """Number of the latched fault, 0 for none."""
        return self._fault["number"] if self._fault else 0

    def now(self) -> JsonDict | None:
        """``code``, ``cause`` and ``help`` of the fault that the loop is in; None when it is in none."""
        if self._rig().state != w.FAULT:
            return None
        fault = self._fault or self._described()
        return {key: fault[key] for key in ("code", "cause", "help")}

    def refuse(self) -> None:
        """Refuse while a fault is latched.

        Raises:
            Refused: with its cause.
        """
        if self._rig().state == w.FAULT:
            fault = self.now()
            cause = f"{fault['code']}: {fault['cause']}" if fault else "a fault"
            raise Refused("fault", f"a fault is latched ({cause}); look at the rig, then 'hapticd clear'")

    def note(self) -> None:
        """Latch a new fault on disk, say it once, keep the 10 s before it."""
        with self.lock:
            if self._rig().state == w.FAULT and self._fault is None and self._rig().fault_number:
                self.keep(self._described())

    def keep(self, fault: JsonDict) -> None:
        """The same for a fault that the loop did not raise itself."""
        self._fault = fault
        self.counts[fault["code"]] += 1
        fields = {"fault": fault["code"], "cause": fault["cause"], "help": fault["help"]}
        log.error("fault %s: %s (%s)", fault["code"], fault["cause"], fault["help"], extra={"journal": fields})
        try:
            self._latch.store(fault)
        except OSError as error:
            log.error("the fault cannot be latched across a restart: %s: %s", self._latch.path, error.strerror)
        # Off the supervisor's thread, which must go on beating while the disk works.
        threading.Thread(target=self._keep_past, args=(fault["code"],), name="hapticd-history", daemon=True).start()

    def cleared(self, before: int) -> None:
        """The loop was asked to clear: forget the fault, unless it is there again.

        Args:
            before: number of the fault that was to be cleared.

        Raises:
            Refused: it, or another one, is there.
        """
        with self.lock:
            if self._rig().state == w.FAULT:
                # It may be another one by now.
                self._fault = None
                self.note()
                cause = self._fault["cause"] if self._fault else faults.KINDS[before].code
                raise Refused("fault_persists", f"the fault is still there: {cause}")
            self._fault = None
            self._latch.remove()

    def servo_died(self) -> None:
        """The servo thread has ended by itself: close the driver, and say so in the loop's place."""
        rig = self._rig()
        if rig.servo.alive() or rig.state == w.FAULT:
            return
        log.critical("the servo thread has ended by itself; closing the driver")
        rig.driver.close()
        with self.lock:
            # The loop is gone, so its atomics are ours to write.
            rig.core.store(atomics.FAULT_CODE, faults.DRIVER_ERROR)
            rig.core.store(atomics.MODE, w.FAULT)
            detail = "the servo thread ended by itself; restart the daemon"
            self.keep(faults.describe(faults.DRIVER_ERROR, -1, 0, is_linear=False, detail=detail))

    def _described(self) -> JsonDict:
        rig = self._rig()
        number = rig.fault_number or faults.ESTOP
        value, limit = float(rig.core.snapshot["fault_value"]), float(rig.core.snapshot["fault_limit"])
        return faults.describe(number, value, limit, is_linear=rig.config.is_linear, detail=rig.driver.error)

    def _keep_past(self, code: str) -> None:
        time.sleep(0.1)
        try:
            path = self._rig().recorder.dump_past(code)
            log.info("the 10 s before the fault are in %s", path)
        except RecordingError as error:
            log.error("the 10 s before the fault could not be kept: %s", error)
        finally:
            self._past_kept()
