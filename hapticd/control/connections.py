"""How many connections a server holds, and for how long: the daemon's on its Unix socket and the scope's on TCP.

A connection costs a descriptor before anything is known of who has made it. So each request's head has a deadline, and
connections are members of a crowd that has a limit; where one more comes, the oldest that is silent has to go: a newcomer is
always served. Silent is who has sent nothing that is still to be read and whose requests are all answered; a stream that is
being read is not.
"""

from __future__ import annotations

import asyncio
import select
from collections.abc import Hashable
from typing import Any, Final

from h11 import Request
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S: Final = 2.0
"""From connecting, or from the first byte of a further request, to the end of its head."""
_UNREAD_S: Final = 0.1
LEAVE: Final = "leave_crowd"
"""In a request's state: a function without arguments, by which its connection leaves the crowd: whose it is, is known."""


class Crowd:
    """Connections that share a limit.

    Args:
        limit: how many. Where none of them is silent, twice as many; beyond that the oldest has to go whatever it does.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._members: dict[LimitedProtocol, None] = {}

    def __len__(self) -> int:
        return len(self._members)

    def join(self, newcomer: LimitedProtocol) -> None:
        """Take in one more, in the place of another where there are enough."""
        if len(self._members) >= self._limit:
            for member in [member for member in self._members if member.transport.is_closing()]:
                self.leave(member)
        while len(self._members) >= self._limit:
            oldest = next((member for member in self._members if member.is_silent()), None)
            if oldest is None:
                if len(self._members) < 2 * self._limit:
                    break
                oldest = next(iter(self._members))
            self.leave(oldest)
            oldest.transport.abort()
        self._members[newcomer] = None

    def leave(self, member: LimitedProtocol) -> None:
        """Count it no more; nothing where it is none of them."""
        self._members.pop(member, None)


class Crowds:
    """A crowd for each user; a user's connections stand in nobody else's way."""

    def __init__(self) -> None:
        self._crowds: dict[Hashable, Crowd] = {}

    def of(self, user: Hashable, limit: int) -> Crowd:
        """The crowd of a user, whose limit is that of its first member."""
        for empty in [found for found, crowd in self._crowds.items() if not len(crowd)]:
            del self._crowds[empty]
        return self._crowds.setdefault(user, Crowd(limit))


class LimitedProtocol(H11Protocol):
    """HTTP with a deadline for the head of each request, and a place in a crowd."""

    _head_due: asyncio.TimerHandle | None = None
    _crowd: Crowd | None = None

    def crowd(self) -> Crowd | None:
        """To which crowd this connection belongs, when it is made; None: it has been turned away and closed."""
        raise NotImplementedError

    def is_silent(self) -> bool:
        """Whether nobody waits for anything here."""
        return not (self._is_answering() or self._has_unread())

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a head."""
        super().connection_made(transport)
        self._crowd = self.crowd()
        if self._crowd is not None:
            self._crowd.join(self)
            self.app_state = {**self.app_state, LEAVE: self._leave}
            self._expect_head(HEAD_S)

    def connection_lost(self, exc: Exception | None) -> None:
        """Leave room for another."""
        self._head_came()
        self._leave()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Wait for the rest of a further request's head, too."""
        super().data_received(data)
        if self._head_due is None and not self._is_answering() and self.transport.get_protocol() is self:
            self._expect_head(HEAD_S)

    def handle_events(self) -> None:
        """See when a head is complete."""
        before = self.cycle
        super().handle_events()
        if self.cycle is not before:
            self._head_came()

    def handle_websocket_upgrade(self, event: Request) -> None:
        """From here on it is another protocol's."""
        self._head_came()
        super().handle_websocket_upgrade(event)

    def _leave(self) -> None:
        if self._crowd is not None:
            self._crowd.leave(self)

    def _is_answering(self) -> bool:
        cycle: Any = self.cycle
        return cycle is not None and not cycle.response_complete

    def _has_unread(self) -> bool:
        """Whether there is something that the event loop has not come to read yet, as the kernel says."""
        poll = select.poll()
        try:
            poll.register(self.transport.get_extra_info("socket").fileno(), select.POLLIN)
            return bool(poll.poll(0))
        except (OSError, ValueError):
            return False

    def _expect_head(self, within_s: float) -> None:
        self._head_due = self.loop.call_later(within_s, self._no_head)

    def _head_came(self) -> None:
        if self._head_due is not None:
            self._head_due.cancel()
            self._head_due = None

    def _no_head(self) -> None:
        self._head_due = None
        if self._has_unread():  # it came in time, and we were late
            self._expect_head(_UNREAD_S)
        else:
            self.transport.abort()
