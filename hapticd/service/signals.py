"""Signals of the daemon: which end it, which has it read its config anew, and zero current before anything else is done.

From a terminal no key may leave the current as it is. SIGINT, SIGQUIT and a closed window end the daemon; SIGTSTP stops the
motor and does not suspend the process, for a suspended daemon watches nothing.
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
    """Takes the signals of this process; made in its main thread.

    Attributes:
        ending: whether one has come that ends the daemon.

    Raises:
        RuntimeError: the system gives no thread.
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
        elif signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup wants it to go on
            signal.signal(signal.SIGHUP, self._end)
        signal.signal(signal.SIGTSTP, self._suspend)
        # Said from the background, or asked there: no reason to freeze with a current on.
        signal.signal(signal.SIGTTOU, signal.SIG_IGN)
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)

    def halt_with(self, disable: Callable[[], None], stop: Callable[[], object]) -> None:
        """A daemon is there; a signal that ends it has come already, perhaps.

        Args:
            disable: zero current at once, and no start any more. stop: the same, and it may be started again. Both are
                called in the signal's handler, so that they may wait for nothing.
        """
        self._disable, self._stop = disable, stop
        if self.ending:
            disable()

    def wait(self, timeout_s: float) -> Literal["end", "reload"] | None:
        """What a signal asks for; None when none has come in time."""
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
    """Whether this process has a controlling terminal, whose end is to be its own."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC))
    except OSError:
        return False
    return True


def _log_suspend() -> None:
    log.warning("SIGTSTP (Ctrl-Z): the motor is stopped, the daemon goes on: suspended it would watch nothing")


def _log_stacks() -> None:
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    for ident, frame in sys._current_frames().items():
        stack = "".join(traceback.format_stack(frame))
        log.warning("SIGQUIT: the thread %s is at\n%s", names.get(ident, ident), stack.rstrip())
