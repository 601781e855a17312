"""Enough descriptors for a server, and rate-limited log messages if they run out or requests are malformed."""

from __future__ import annotations

import logging
import resource
import time
from collections.abc import Callable
from typing import Final

MOST: Final = 65_536
"""Above all limits on connections; a larger table of descriptors would cost memory."""
EVERY_S: Final = 10.0
_SERVERS: Final = ("asyncio", "uvicorn.error")


class Seldom(logging.Filter):
    """Rate limit for repeated messages of a logger; a passed message has the number of suppressed ones.

    asyncio logs a traceback for each connection that it cannot accept, a hundred in a row, and would fill the disk.

    Args:
        every_s: time between two equal messages, s. clock: s.
    """

    def __init__(self, every_s: float = EVERY_S, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._every_s, self._clock = every_s, clock
        self._passed: dict[str, float] = {}
        self._left_out: dict[str, int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record passes."""
        kind = f"{record.module}:{record.lineno}: {record.exc_info[0] if record.exc_info else ''}"
        now = self._clock()
        if now - self._passed.get(kind, float("-inf")) < self._every_s:
            self._left_out[kind] = self._left_out.get(kind, 0) + 1
            return False
        self._passed[kind] = now
        if count := self._left_out.pop(kind, 0):
            record.msg, record.args = f"{record.getMessage()}\n({count} more like this before it)", None
        return True


def prepare(most: int = MOST) -> None:
    """Raise this process's soft limit of descriptors to the hard one, and limit the rate of the servers' log messages.

    The usual soft limit of 1024 is for programs that use select(2).

    Args:
        most: upper bound of the new limit.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = most if hard == resource.RLIM_INFINITY else min(hard, most)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    for name in _SERVERS:
        logger = logging.getLogger(name)
        if not any(isinstance(found, Seldom) for found in logger.filters):
            logger.addFilter(Seldom())
