"""A thread that exists from the start and does, in order, what others may not wait for: nobody starts one later."""

from __future__ import annotations

import logging
import threading
from queue import SimpleQueue
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)


class Background:
    """One thread and what it still has to do.

    Args:
        name: of the thread.

    Raises:
        RuntimeError: the system gives no thread.
    """

    def __init__(self, name: str) -> None:
        self._waiting: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._works = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def ask(self, function: Callable[[], None]) -> None:
        """Have it done after what waits already; returns at once, needs no lock and no memory to speak of."""
        self._waiting.put(function)

    def waiting(self) -> int:
        """How many wait to be done, the one at work not counted."""
        return self._waiting.qsize()

    def alive(self) -> bool:
        """Whether the thread still runs."""
        return self._thread.is_alive()

    def busy(self) -> bool:
        """Whether it has something to do."""
        return self._works or not self._waiting.empty()

    def end(self, timeout_s: float) -> bool:
        """Do what waits, and no more; False when that took longer."""
        self._waiting.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (function := self._waiting.get()) is not None:
            self._works = True
            try:
                function()
            except Exception:
                log.exception("the thread %s goes on after an error", self._thread.name)
            self._works = False
