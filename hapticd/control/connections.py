"""Limits on the number and age of connections: of the daemon on its Unix socket, and of the scope on TCP.

A connection uses a descriptor before its user is known. So the header of each request has a deadline, and connections share
a limit. A new connection beyond the limit closes the oldest idle one, so a new one is always served. A connection is idle
if it has no unread data and all its requests are answered; a stream with a reader is not idle.
"""

from __future__ import annotations

import asyncio
import select
from collections.abc import Hashable
from typing import Any, Final

from h11 import Request
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S: Final = 2.0
"""Longest time from connecting, or from the first byte of a further request, to the end of its header [s]."""
_UNREAD_S: Final = 0.1
LEAVE: Final = "leave_crowd"
"""Key in a request's state: a function that exempts its connection from the limit, once its user is known."""


class Crowd:
    """Connections that share a limit.

    Args:
        limit: number of connections; twice as many if none is idle. Beyond that the oldest is closed in any case.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._members: dict[LimitedProtocol, None] = {}

    def __len__(self) -> int:
        return len(self._members)

    def join(self, newcomer: LimitedProtocol) -> None:
        """Add a connection; beyond the limit, close another."""
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
        """Remove a connection, if it is a member."""
        self._members.pop(member, None)


class Crowds:
    """A separate limit for each user, so that a user cannot block others."""

    def __init__(self) -> None:
        self._crowds: dict[Hashable, Crowd] = {}

    def of(self, user: Hashable, limit: int) -> Crowd:
        """The crowd of a user, with the limit of its first member."""
        for empty in [found for found, crowd in self._crowds.items() if not len(crowd)]:
            del self._crowds[empty]
        return self._crowds.setdefault(user, Crowd(limit))


class LimitedProtocol(H11Protocol):
    """HTTP with a deadline for the header of each request, and a limit on connections."""

    _head_due: asyncio.TimerHandle | None = None
    _crowd: Crowd | None = None

    def crowd(self) -> Crowd | None:
        """The crowd of a new connection; None if it was refused and closed."""
        raise NotImplementedError

    def is_silent(self) -> bool:
        """Whether the connection is idle."""
        return not (self._is_answering() or self._has_unread())

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start to wait for a header."""
        super().connection_made(transport)
        self._crowd = self.crowd()
        if self._crowd is not None:
            self._crowd.join(self)
            self.app_state = {**self.app_state, LEAVE: self._leave}
            self._expect_head(HEAD_S)

    def connection_lost(self, exc: Exception | None) -> None:
        """Leave the crowd."""
        self._head_came()
        self._leave()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Start the deadline of a further request's header."""
        super().data_received(data)
        if self._head_due is None and not self._is_answering() and self.transport.get_protocol() is self:
            self._expect_head(HEAD_S)

    def handle_events(self) -> None:
        """Detect a complete header."""
        before = self.cycle
        super().handle_events()
        if self.cycle is not before:
            self._head_came()

    def handle_websocket_upgrade(self, event: Request) -> None:
        """Hand the connection over to the WebSocket protocol."""
        self._head_came()
        super().handle_websocket_upgrade(event)

    def _leave(self) -> None:
        if self._crowd is not None:
            self._crowd.leave(self)

    def _is_answering(self) -> bool:
        cycle: Any = self.cycle
        return cycle is not None and not cycle.response_complete

    def _has_unread(self) -> bool:
        """Whether the kernel has data that the event loop has not read yet."""
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
        if self._has_unread():  # it arrived in time, but the event loop was late
            self._expect_head(_UNREAD_S)
        else:
            self.transport.abort()
