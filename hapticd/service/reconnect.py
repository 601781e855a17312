"""Opens a lost device again (``driver.reconnect``), on a new rig, with the fault still latched.

Opening may take seconds, so it has its own thread. Meanwhile the servo loop of the lost device continues to tick, which the
service manager's watchdog needs.
"""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from drivers import DriverError
from hapticd.service.rig import opened_driver
from hapticd.servo import layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.interface import Driver
    from hapticd.service.rig import Rig

log = logging.getLogger(__name__)

RETRY_S = 1.0
"""Time between two attempts."""


class Reconnector:
    """Tries to open a lost device until it answers.

    Args:
        rig: returns the present rig.
        is_latched: returns whether its fault is described and on disk; before that, its driver is not touched.
        take_over: replaces a rig by one with the opened driver; called from this thread.
    """

    def __init__(
        self, rig: Callable[[], Rig], is_latched: Callable[[], bool], take_over: Callable[[Rig, Driver], None]
    ) -> None:
        self._rig, self._is_latched, self._take_over = rig, is_latched, take_over
        self._ending = threading.Event()
        self._abandoned: Rig | None = None
        self._said = ""
        self._thread = threading.Thread(target=self._run, name="hapticd-reconnect", daemon=True)
        self._thread.start()

    def alive(self) -> bool:
        """Whether its thread runs."""
        return self._thread.is_alive()

    def end(self) -> None:
        """Stop trying. It does not wait for a running attempt, whose device is closed at once."""
        self._ending.set()

    def _run(self) -> None:
        while not self._ending.wait(RETRY_S):
            rig = self._rig()
            if not (rig.config.driver.reconnect and rig.state == layout.FAULT and rig.device_lost):
                continue
            if self._is_latched():
                try:
                    self._attempt(rig)
                except Exception as error:
                    if self._is_news(error):
                        log.exception("reconnecting continues after an error")

    def _attempt(self, rig: Rig) -> None:
        if rig is not self._abandoned:
            rig.driver.close()
            self._abandoned, self._said = rig, ""
        try:
            driver = opened_driver(rig.config)
        except DriverError as error:
            if self._is_news(error):
                log.warning("the device is not back yet: %s", error)
            return
        self._take_over(rig, driver)

    def _is_news(self, error: Exception) -> bool:
        """Whether the error differs from that of the last attempt; a repeated error is logged once."""
        before, self._said = self._said, str(error)
        return self._said != before
