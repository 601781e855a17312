"""Replaces the rig: for a config that the present rig cannot apply, or for a device that is connected again."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import drivers
from drivers import DriverError
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.service.rendering import enforce
from hapticd.service.rig import Rig
from hapticd.servo import faults, layout
from hapticd.stability.guard import judge

if TYPE_CHECKING:
    from drivers.interface import Driver
    from hapticd.config import Config
    from hapticd.control.endpoints import JsonDict
    from hapticd.service.experiments import Experiments
    from hapticd.service.fault_manager import FaultManager
    from hapticd.service.heat import Heat
    from hapticd.service.live import LiveStream
    from hapticd.service.rendering import Rendering

log = logging.getLogger(__name__)


class Replacement:
    """Replaces the rig. Its methods are called with the daemon's lock held.

    Args:
        rendering: has the present rig.
        live: stream for every rig. heat: I²t of the motor.

    Attributes:
        dead: whether there is no working rig; the process must end.
    """

    def __init__(
        self, rendering: Rendering, fault_manager: FaultManager, experiments: Experiments, live: LiveStream, heat: Heat
    ) -> None:
        self.dead = False
        self._rendering, self._faults, self._experiments = rendering, fault_manager, experiments
        self._live, self._heat = live, heat

    def with_config(self, config: Config, fixed: list[str], force: bool) -> JsonDict:
        """A rig for a config in which the keys ``fixed`` differ; returns the guard's judgement.

        Raises:
            Refused: the spring is rendered, the daemon must be restarted for it, or the driver or the guard refuses it.
            DriverFailure: it failed, and the previous config is applied again.
        """
        if self._rendering.rig.state in (layout.READY, layout.RUNNING):
            raise Refused(
                "restart_needed",
                f"{', '.join(fixed)}: cannot change while the spring is rendered; 'hapticd stop' first",
            )
        self._experiments.cancel()
        if any(key.startswith("api.") for key in fixed):
            raise Refused("restart_needed", f"{', '.join(fixed)}: cannot change without a restart of the daemon")
        try:
            latency_s = drivers.create(config).latency_s
        except DriverError as error:
            raise Refused("driver", f"{error}; the present configuration stays") from error
        judgement = enforce(judge(config, latency_s, force=force))
        old = self._rendering.rig
        self._faults.latch_raised()  # before the rig, which has its value and limit, is closed
        old.close(self._heat.keep)
        try:
            self._put(config, old.fault_number, known=old.position_known)
        except Exception as error:
            log.error("the new configuration failed (%s); going back to the old one, with a latched fault", error)
            with self._faults.lock:
                self._rendering.authority.faulted()
                self._faults.latch(faults.describe(faults.RELOAD_FAILED, 0.0, 0.0, is_linear=False, detail=str(error)))
                try:
                    self._put(old.config, faults.RELOAD_FAILED, known=old.position_known)
                except Exception:
                    log.critical("the old configuration failed too; the daemon ends", exc_info=True)
                    self.dead = True
            raise DriverFailure(f"reload failed: {error}") from error
        return judgement

    def on_device(self, lost: Rig, driver: Driver) -> None:
        """A new rig on the device that was lost and is open again, with the fault still latched."""
        self._experiments.cancel()
        lost.close(self._heat.keep)
        try:
            self._put(lost.config, lost.fault_number or faults.DRIVER_LOST, driver, known=False)
        except Exception:
            log.critical("the device is back, and cannot be used; the daemon ends", exc_info=True)
            driver.close()
            self.dead = True
            return
        log.info(
            "%s is open again; the fault stays until 'hapticd clear', the origin has to be set anew", driver.describe()
        )

    def _put(self, config: Config, fault: int, driver: Driver | None = None, *, known: bool) -> None:
        # An estop during the replacement is for the new rig.
        before, words = self._rendering.rig.core, self._rendering.authority.words
        self._rendering.rig = Rig(
            config,
            fault,
            self._live,
            self._heat.name,
            driver,
            position_known=known,
            words=words,
            estops_obeyed=before.estops_obeyed,
            i2t=before.i2t,
        )
