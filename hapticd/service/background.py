"""A thread, created at the start, that executes in order what other threads must not wait for."""

from __future__ import annotations

import logging
import threading
from queue import SimpleQueue
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)


class Background:
    """One thread with a queue of functions.

    Args:
        name: of the thread.

    Raises:
        RuntimeError: a thread cannot be created.
    """

    def __init__(self, name: str) -> None:
        self._waiting: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._works = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def ask(self, function: Callable[[], None]) -> None:
        """Queue a function; returns at once, and takes no lock."""
        self._waiting.put(function)

    def waiting(self) -> int:
        """Number of queued functions, without the running one."""
        return self._waiting.qsize()

    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def busy(self) -> bool:
        """Whether a function is running or queued."""
        return self._works or not self._waiting.empty()

    def end(self, timeout_s: float) -> bool:
        """Execute the queued functions, then end; False on a time-out."""
        self._waiting.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (function := self._waiting.get()) is not None:
            self._works = True
            try:
                function()
            except Exception:
                log.exception("the thread %s continues after an error", self._thread.name)
            self._works = False
