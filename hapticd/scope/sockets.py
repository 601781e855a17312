"""The scope's two WebSockets: the rows as the daemon sends them, and the state with who holds the controls."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from typing import Any, Protocol

from starlette.websockets import WebSocket, WebSocketDisconnect

from hapticd.control.json_reply import to_json
from hapticd.scope.access import Access, Role
from hapticd.scope.forms import CLIENT, read_json
from hapticd.scope.hub import Hub
from hapticd.scope.lease import Lease
from hapticd.scope.strangers import has_token

HELLO_TIMEOUT_S = 5.0
MAX_CONNECTIONS = 64
CLOSE_TOKEN = 4401
CLOSE_FULL = 4429


class Shared(Protocol):
    """What pages share: who may, what the daemon says, who holds the controls, how many connections there are."""

    access: Access
    hub: Hub
    lease: Lease
    connections: int


class Sockets:
    """What the pages are told.

    Args:
        server: what they share.
    """

    def __init__(self, server: Shared) -> None:
        self._server = server

    async def rows(self, socket: WebSocket) -> None:
        """Frames, as the daemon sends them."""
        await self._serve(socket, self._send_rows)

    async def state(self, socket: WebSocket) -> None:
        """State, config, and who holds the controls."""
        await self._serve(socket, self._send_state)

    async def _serve(self, socket: WebSocket, serve: Callable[[WebSocket, Role, str], Awaitable[None]]) -> None:
        with contextlib.suppress(WebSocketDisconnect):
            hello = await self._greet(socket)
            if hello is None:
                return
            has_token(socket)
            if self._server.connections >= MAX_CONNECTIONS:
                await socket.close(CLOSE_FULL)
                return
            self._server.connections += 1
            try:
                await serve(socket, *hello)
            finally:
                self._server.connections -= 1

    async def _greet(self, socket: WebSocket) -> tuple[Role, str] | None:
        """Role and client of a WebSocket whose first message carries a token; any other is closed."""
        await socket.accept()
        hello = await _hello(socket)
        role, client = self._server.access.role(hello.get("token")), hello.get("client")
        if role is None or not isinstance(client, str) or not CLIENT.fullmatch(client):
            await socket.close(CLOSE_TOKEN, "this token is not one of this start's; use the URL just printed")
            return None
        return role, client

    async def _send_rows(self, socket: WebSocket, role: Role, client: str) -> None:
        queue = self._server.hub.watch_rows()

        async def send() -> None:
            while True:
                await socket.send_bytes(await queue.get())

        try:
            await _until_gone(socket, send)
        finally:
            self._server.hub.leave_rows(queue)

    async def _send_state(self, socket: WebSocket, role: Role, client: str) -> None:
        queue = self._server.hub.watch_state()
        if role == "command":
            self._server.lease.claim(client)

        async def send() -> None:
            while True:
                message = await queue.get()
                lease = {**self._server.lease.report(client), "may": role == "command"}
                await socket.send_text(to_json({**message, "lease": lease}).decode())

        try:
            await _until_gone(socket, send)
        finally:
            self._server.hub.leave_state(queue)
            self._server.lease.gone(client)


async def _hello(socket: WebSocket) -> dict[str, Any]:
    """The first message; an empty one when it does not come in time or is no JSON object."""
    try:
        async with asyncio.timeout(HELLO_TIMEOUT_S):
            found = read_json(await socket.receive_text())
    except (TimeoutError, ValueError, KeyError):
        return {}
    return found if isinstance(found, dict) else {}


async def _until_gone(socket: WebSocket, send: Callable[[], Any]) -> None:
    """Send until the page goes; what it says meanwhile is read and ignored."""
    sending = asyncio.ensure_future(send())
    receiving = asyncio.ensure_future(_listen(socket))
    try:
        await asyncio.wait({sending, receiving}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (sending, receiving):
            task.cancel()
        for outcome in await asyncio.gather(sending, receiving, return_exceptions=True):
            if isinstance(outcome, Exception) and not isinstance(outcome, WebSocketDisconnect | RuntimeError):
                raise outcome


async def _listen(socket: WebSocket) -> None:
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
