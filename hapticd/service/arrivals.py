"""Handles a request when its header arrives, in the event loop, before its body is read, checked or queued.

A stop or an estop is executed here: one store, which the tick reads, revokes every command that was sent earlier. A command
for motion, or to clear a fault, gets its ordinal (`hapticd.servo.authority`), its deadline, and its connection: when that
closes, the command is withdrawn. The ordinal is the time of sending from the header, or else a lower bound of it
(`hapticd.service.access.Connection.sent_ns`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

    from hapticd.control.endpoints import Endpoint, JsonDict
    from hapticd.service.access import Connection, Rules
    from hapticd.servo.authority import Authority, Command

DEADLINE: Final = b"request-deadline-ns"
"""Header: CLOCK_MONOTONIC, in ns, after which the motion must not start."""
SENT: Final = b"request-sent-ns"
"""Header: CLOCK_MONOTONIC, in ns, at which the request was sent."""

_DIGITS: Final = 19
"""Most digits of a time in ns; a number with more digits counts as infinite."""


class Pending(Protocol):
    """A stop that is executed, and whose answer is pending."""

    def poll(self) -> JsonDict | None:
        """The answer; None: not yet."""


class Stoppable(Protocol):
    """The daemon's interface to an arriving request."""

    authority: Authority

    def halt(self, name: str) -> Pending:
        """Stop at once."""


@dataclass(frozen=True)
class Arrival:
    """Result of handling a request on its arrival."""

    command: Command | None = None
    halt: Pending | None = None


ARRIVAL: ContextVar[Arrival] = ContextVar("arrival")
"""That of the present request."""


class Arrivals:
    """The outermost layer of the API."""

    def __init__(self, app: ASGIApp, control: Stoppable, rules: Rules, endpoints: Iterable[Endpoint]) -> None:
        self.app, self._control, self._rules = app, control, rules
        posted = [endpoint for endpoint in endpoints if endpoint.method == "POST"]
        self._stops = {endpoint.path: endpoint.name for endpoint in posted if endpoint.queue in ("stop", "estop")}
        self._motion_s = {endpoint.path: endpoint.motion_s for endpoint in posted if endpoint.motion_s is not None}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Execute a stop, give a command its ordinal, and pass everything on."""
        if scope["type"] == "http":
            ARRIVAL.set(self._arrival(scope) if scope["method"] == "POST" else Arrival())
        await self.app(scope, receive, send)

    def _arrival(self, scope: Scope) -> Arrival:
        state, path = scope.get("state", {}), scope["path"]
        if path in self._stops:
            caller = state.get("caller")
            may = caller is not None and self._rules.role(caller) == "control"
            return Arrival(halt=self._control.halt(self._stops[path]) if may else None)
        if path in self._motion_s:
            return Arrival(command=self._command(self._motion_s[path], dict(scope["headers"]), state.get("connection")))
        return Arrival()

    def _command(self, limit_s: float, headers: Mapping[bytes, Any], connection: Connection | None) -> Command:
        not_after_ns, sent_ns = _nanoseconds(headers, DEADLINE), _nanoseconds(headers, SENT)
        not_after_s = math.inf if not_after_ns is None else not_after_ns * 1e-9
        if connection is None:
            return self._control.authority.arrived(limit_s, not_after_s=not_after_s, sent_ns=sent_ns)
        sent_ns = connection.sent_ns if sent_ns is None else sent_ns
        return self._control.authority.arrived(limit_s, connection.is_there, not_after_s, sent_ns)


def _nanoseconds(headers: Mapping[bytes, Any], name: bytes) -> int | None:
    given = headers.get(name, b"")
    return int(given) if given.isdigit() and len(given) <= _DIGITS else None
