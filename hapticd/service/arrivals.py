"""What becomes of a request when its head arrives, in the event loop, before anything of it is read, checked or queued.

A stop or an estop is carried out here: every command that was sent earlier is revoked by one store that the tick reads. One
that asks for motion, or clears a fault, gets its ordinal (`hapticd.servo.authority`), its deadline, and the connection it
dies with. Its ordinal is the time at which its sender says that it was sent; where it does not say, the last time at which
it is known not to have been there yet (`hapticd.service.access.Connection.sent_ns`).
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
"""Header: CLOCK_MONOTONIC, in ns, after which its sender no longer wants motion to begin."""
SENT: Final = b"request-sent-ns"
"""Header: CLOCK_MONOTONIC, in ns, at which it was sent."""

_DIGITS: Final = 19
"""Of a number of ns; a longer one is after every clock's end."""


class Pending(Protocol):
    """A stop that has been carried out, and whose answer is waited for."""

    def poll(self) -> JsonDict | None:
        """The answer; None: ask again."""


class Stoppable(Protocol):
    """The daemon, as an arriving request sees it."""

    authority: Authority

    def halt(self, name: str) -> Pending:
        """Stop at once."""


@dataclass(frozen=True)
class Arrival:
    """What was done with a request on its arrival."""

    command: Command | None = None
    halt: Pending | None = None


ARRIVAL: ContextVar[Arrival] = ContextVar("arrival")
"""Of the request at hand."""


class Arrivals:
    """The outermost layer of the API."""

    def __init__(self, app: ASGIApp, control: Stoppable, rules: Rules, endpoints: Iterable[Endpoint]) -> None:
        self.app, self._control, self._rules = app, control, rules
        posted = [endpoint for endpoint in endpoints if endpoint.method == "POST"]
        self._stops = {endpoint.path: endpoint.name for endpoint in posted if endpoint.queue in ("stop", "estop")}
        self._motion_s = {endpoint.path: endpoint.motion_s for endpoint in posted if endpoint.motion_s is not None}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Carry out a stop, number a command; pass everything on."""
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
