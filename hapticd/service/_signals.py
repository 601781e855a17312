"""Signal handlers: each sets zero current first. Some signals end the daemon, one reloads its config.

A key in the terminal must never leave a current on. SIGINT, SIGQUIT and a closed window end the daemon; SIGTSTP stops the
motor and does not suspend the process, because a suspended daemon supervises nothing.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
import traceback
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Literal

from hapticd.service.background import Background

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)


class Signals:
    """Handles the signals of this process; created in its main thread.

    Attributes:
        ending: whether a signal that ends the daemon has arrived.

    Raises:
        RuntimeError: a thread cannot be created.
    """

    def __init__(self) -> None:
        self.ending = False
        self._came: SimpleQueue[Literal["end", "reload"]] = SimpleQueue()
        self._at_once = Background("hapticd-signals")
        self._disable: Callable[[], None] | None = None
        self._stop: Callable[[], object] | None = None
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGQUIT):
            signal.signal(number, self._end)
        if not has_terminal():
            signal.signal(signal.SIGHUP, self._reload)
        elif signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # with nohup it continues
            signal.signal(signal.SIGHUP, self._end)
        signal.signal(signal.SIGTSTP, self._suspend)
        # Terminal access in the background must not suspend the process with a current on.
        signal.signal(signal.SIGTTOU, signal.SIG_IGN)
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)

    def halt_with(self, disable: Callable[[], None], stop: Callable[[], object]) -> None:
        """Set the functions of the daemon; an ending signal may have arrived already.

        Args:
            disable: zero current at once, and no further start. stop: zero current, and it may be started again. Both are
                called in the signal handler, so they must not wait.
        """
        self._disable, self._stop = disable, stop
        if self.ending:
            disable()

    def wait(self, timeout_s: float) -> Literal["end", "reload"] | None:
        """Wait for a signal; None on a time-out."""
        try:
            return self._came.get(timeout=timeout_s)
        except Empty:
            return None

    def _end(self, number: int, frame: Any) -> None:
        self.ending = True
        if self._disable is not None:
            self._disable()
        if number == signal.SIGQUIT:
            self._at_once.ask(_log_stacks)
        self._came.put("end")

    def _reload(self, number: int, frame: Any) -> None:
        self._came.put("reload")

    def _suspend(self, number: int, frame: Any) -> None:
        if self._stop is not None:
            self._stop()
        self._at_once.ask(_log_suspend)


def has_terminal() -> bool:
    """Whether this process has a controlling terminal; the daemon ends with it."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC))
    except OSError:
        return False
    return True


def _log_suspend() -> None:
    log.warning("SIGTSTP (Ctrl-Z): the motor is stopped, the daemon continues: suspended, it would supervise nothing")


def _log_stacks() -> None:
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    for ident, frame in sys._current_frames().items():
        stack = "".join(traceback.format_stack(frame))
        log.warning("SIGQUIT: the thread %s is at\n%s", names.get(ident, ident), stack.rstrip())
