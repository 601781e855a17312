"""Who holds the controls: one page at a time; another may take over, and everybody sees who has them.

Stop and e-stop need no lease.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

KEPT_S = 10.0
"""How long the controls wait for a page that went away, so that a reload does not lose them."""


class Lease:
    """The controls of one daemon."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.holder: str | None = None
        self._gone_at: float | None = None
        self._clock = clock

    def _expire(self) -> None:
        if self._gone_at is not None and self._clock() - self._gone_at > KEPT_S:
            self.holder, self._gone_at = None, None

    def claim(self, client: str, *, take_over: bool = False) -> bool:
        """Take the controls if they are free, or in any case with ``take_over``; whether the client has them now."""
        self._expire()
        if self.holder is None or take_over or self.holder == client:
            self.holder, self._gone_at = client, None
        return self.holder == client

    def release(self, client: str) -> None:
        """Give the controls back at once."""
        if self.holder == client:
            self.holder, self._gone_at = None, None

    def gone(self, client: str) -> None:
        """The client's page went away; perhaps it comes back."""
        if self.holder == client:
            self._gone_at = self._clock()

    def held_by(self, client: str | None) -> bool:
        """Whether this client holds them."""
        self._expire()
        return client is not None and self.holder == client

    def report(self, client: str) -> dict[str, Any]:
        """What a page is told: ``mine`` and ``free``; never another page's name, which is a secret of that page."""
        self._expire()
        return {"mine": self.holder == client, "free": self.holder is None}
