"""Access control: user and groups of each caller, from the kernel, and the role that they give.

The credentials are those of the caller's process when it connected (``SO_PEERCRED``, ``SO_PEERGROUPS``; unix(7)), so one
socket serves two roles: *control* may command the motor, *watch* may only read. Each command is logged with its caller.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import pwd
import select
import socket
import struct
import time
from collections import deque
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, Literal

from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from hapticd.control.json_reply import error_reply

Role = Literal["control", "watch"]

_SO_PEERGROUPS = 59
_UCRED = struct.Struct("3i")
_LONGEST_OPTION = 1024
"""Largest buffer that Python allows for getsockopt [bytes]."""
_LOOKING = frozenset({"GET", "HEAD", "OPTIONS"})
_TURNS = 6
"""Iterations of the event loop that are kept: those between accepting a connection and creating its protocol, plus one."""
_LOOK_S = 0.05
_BLIND_NS = 2_000_000_000
"""After a failed accept [ns]: longer than asyncio's wait before the next attempt."""


@dataclass(frozen=True)
class Caller:
    """The process at the other end of the socket."""

    pid: int
    uid: int
    groups: frozenset[int]

    @property
    def is_own_user(self) -> bool:
        """Whether it runs as the daemon's own user or as root."""
        return self.uid in (0, os.geteuid())

    def __str__(self) -> str:
        """User and process number, for the log."""
        name = ""
        with contextlib.suppress(KeyError):
            name = f" ({pwd.getpwuid(self.uid).pw_name})"
        return f"uid {self.uid}{name}, pid {self.pid}"


CALLER: ContextVar[Caller | None] = ContextVar("caller", default=None)
"""Caller of the present request."""


class Connection:
    """A connection, for the code that handles its request.

    Args:
        transport: of the server's end.
        since_ns: `time.monotonic_ns` before which nothing was sent on it.

    Attributes:
        sent_ns: lower bound of the time at which the last data was sent, as `time.monotonic_ns`.
    """

    def __init__(self, transport: asyncio.Transport, since_ns: int) -> None:
        self._socket = transport.get_extra_info("socket")
        self._lost = False
        self.sent_ns = self._read_ns = since_ns

    def read(self) -> None:
        """The server has read all available data."""
        self.sent_ns, self._read_ns = self._read_ns, time.monotonic_ns()

    def lost(self) -> None:
        """The server has closed its end."""
        self._lost = True

    def is_there(self) -> bool:
        """Whether the other end is still open. It asks the kernel, because the event loop may not know yet."""
        poll = select.poll()
        try:
            poll.register(self._socket.fileno(), 0)
            hung_up = bool(poll.poll(0))
        except (OSError, ValueError):
            return False
        return not (hung_up or self._lost)


def caller_of(connection: socket.socket) -> Caller:
    """The process that connected.

    Args:
        connection: an accepted Unix socket.
    """
    pid, uid, gid = _UCRED.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size))
    return Caller(pid, uid, frozenset({gid, *_other_groups(connection, uid, gid)}))


def _other_groups(connection: socket.socket, uid: int, gid: int) -> list[int]:
    try:
        groups = connection.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, _LONGEST_OPTION)
    except OSError as error:
        if error.errno != errno.ERANGE:
            raise
        # More groups than fit into Python's buffer: use those of the user database.
        return os.getgrouplist(pwd.getpwuid(uid).pw_name, gid)
    return list(struct.unpack(f"{len(groups) // 4}I", groups))


@dataclass(frozen=True)
class Rules:
    """Which group has which role.

    Attributes:
        control: group that may command the motor; None: everybody with permission on the socket.
        watch: group that may read; None: nobody else.
    """

    control: int | None = None
    watch: int | None = None

    def role(self, caller: Caller) -> Role | None:
        """Role of a caller; None for no role. Root and the daemon's own user have all roles."""
        if self.control is None or caller.is_own_user or self.control in caller.groups:
            return "control"
        return "watch" if self.watch in caller.groups else None


class Turns:
    """Times of the last event loop iterations: they bound how long a request has waited, also if the loop was frozen.

    A connection is accepted in the first iteration after it was made, and has its protocol two iterations later. So the
    third iteration before that is a lower bound of the time at which its data was sent. Created before the socket is bound.
    """

    def __init__(self) -> None:
        self._ended_ns: deque[int] = deque([time.monotonic_ns()] * _TURNS, maxlen=_TURNS)
        self._blind_until_ns = 0

    def before_ns(self) -> int:
        """Lower bound of the time at which newly received data was sent, as `time.monotonic_ns`."""
        return self._ended_ns[0]

    def begin(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start to record iterations of a loop, from within it."""
        loop.set_exception_handler(self._failed)
        self._look(loop)

    def _look(self, loop: asyncio.AbstractEventLoop, left: int = _TURNS) -> None:
        """Record some iterations in a row, every 50 ms."""
        now_ns = time.monotonic_ns()
        if now_ns >= self._blind_until_ns:
            self._ended_ns.append(now_ns)
        if left > 1:
            loop.call_soon(self._look, loop, left - 1)
        else:
            loop.call_later(_LOOK_S, self._look, loop)

    def _failed(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """If a connection cannot be accepted, asyncio tries again a second later."""
        if "accept" in context.get("message", ""):
            self._blind_until_ns = time.monotonic_ns() + _BLIND_NS
        loop.default_exception_handler(context)


class CallerProtocol(H11Protocol):
    """HTTP on a Unix socket, with the caller in the state of each request."""

    turns: Turns

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Read the caller's credentials from the kernel."""
        super().connection_made(transport)
        self._connection = Connection(transport, self.turns.before_ns())
        self.app_state = {**self.app_state, "connection": self._connection}
        with contextlib.suppress(OSError, KeyError):
            self.app_state["caller"] = caller_of(transport.get_extra_info("socket"))

    def data_received(self, data: bytes) -> None:
        """Note when."""
        self._connection.read()
        super().data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pending requests of this client will not start."""
        self._connection.lost()
        super().connection_lost(exc)


class Access:
    """Answers 403 if the caller's role does not allow the request; an unknown caller has no role."""

    def __init__(self, app: ASGIApp, rules: Rules) -> None:
        self.app, self.rules = app, rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on allowed requests."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        state: dict[str, Any] = scope.get("state", {})
        caller: Caller | None = state.get("caller")
        role = None if caller is None else self.rules.role(caller)
        if role == "control" or (role == "watch" and scope["method"] in _LOOKING):
            token = CALLER.set(caller)
            try:
                await self.app(scope, receive, send)
            finally:
                CALLER.reset(token)
            return
        may = "may only watch" if role == "watch" else "has no role here"
        who = "the caller is unknown" if caller is None else f"uid {caller.uid} {may}"
        words = f"{who}: {scope['method']} {scope['path']} is for the group api.group of the config"
        await error_reply(403, "forbidden", words)(scope, receive, send)
