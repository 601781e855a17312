"""Who may see and who may command: tokens, and the names under which the page may be reached.

A token is random per start and travels in an Authorization header or a WebSocket's first message, never in a cookie (all
ports of localhost share those) nor in a path or query (those end in logs). Nobody is trusted by address, and no forwarding
header is read. Host and Origin are compared with fixed lists: the first refuses a rebound DNS name, the second another
site's page, and neither is derived from the other.
"""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass, field
from typing import Literal
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from hapticd.control.json_reply import error_reply

Role = Literal["look", "command"]
"""What a token allows."""

TOKEN_BYTES = 24
_LOOPBACK = ("127.0.0.1", "localhost", "[::1]")

HEADERS = (
    (
        b"content-security-policy",
        b"default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'; object-src 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-cache"),
)


@dataclass(frozen=True)
class Access:
    """The tokens of one start.

    Attributes:
        view_token: may look. control_token: may look and command; None: nobody may command from here.
    """

    control_token: str | None = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))
    view_token: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))

    def role(self, token: object) -> Role | None:
        """What this token allows; None: nothing."""
        if not isinstance(token, str):
            return None
        given = token.encode(errors="replace")
        found: Role | None = None
        # Both are compared always, and in constant time.
        if hmac.compare_digest(given, self.view_token.encode()):
            found = "look"
        if self.control_token is not None and hmac.compare_digest(given, self.control_token.encode()):
            found = "command"
        return found

    def bearer(self, headers: Headers) -> Role | None:
        """What the request's one Authorization header allows."""
        given = headers.getlist("authorization")
        scheme, _, token = given[0].partition(" ") if len(given) == 1 else ("", "", "")
        return self.role(token) if scheme.lower() == "bearer" else None


@dataclass(frozen=True)
class Names:
    """Under which names the page may be reached.

    Attributes:
        hosts: allowed Host headers. origins: allowed Origin headers.
    """

    hosts: frozenset[str]
    origins: frozenset[str]

    @classmethod
    def of(cls, host: str, port: int, more_origins: tuple[str, ...] = ()) -> Names:
        """The names of a server on ``host`` and ``port``, which is loopback's too, and further origins.

        Raises:
            ValueError: a further origin is not ``http://host[:port]`` or ``https://host[:port]``.
        """
        names = {*_LOOPBACK, f"[{host}]" if ":" in host else host} - {"0.0.0.0", "[::]"}  # noqa: S104 - taken out, not bound
        origins = {f"http://{name}:{port}" for name in names}
        for origin in more_origins:
            parts = urlsplit(origin)
            if (
                parts.scheme not in ("http", "https")
                or not parts.netloc
                or f"{parts.scheme}://{parts.netloc}" != origin
            ):
                raise ValueError(f"{origin!r} is not an origin; one looks like http://lab-pc:8765, without a path")
            origins.add(origin)
        if port == 80:  # a browser leaves the standard port out
            origins |= {f"http://{name}" for name in names}
        return cls(frozenset(urlsplit(origin).netloc for origin in origins), frozenset(origins))


class Guard:
    """ASGI middleware: refuses foreign Hosts and Origins, HTTP and WebSocket alike, and adds the security headers."""

    def __init__(self, app: ASGIApp, names: Names) -> None:
        self.app, self.names = app, names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what is addressed to us by a page of ours."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if why := self._refusal(scope):
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 1008, "reason": why})
            else:
                await error_reply(403, "foreign", why)(scope, receive, self._with_headers(send))
            return
        await self.app(scope, receive, self._with_headers(send))

    def _refusal(self, scope: Scope) -> str | None:
        headers = Headers(scope=scope)
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0].lower() not in self.names.hosts:
            return "this is not the name of this server; start it with --origin to allow another one"
        # A browser always names the origin of a WebSocket and of a POST; other programs may leave it out of a request.
        if any(origin not in self.names.origins for origin in origins) or len(origins) > 1:
            return "a page of another origin may not ask here; start with --origin to allow it"
        if scope["type"] == "websocket" and not origins:
            return "a WebSocket must name its origin"
        return None

    @staticmethod
    def _with_headers(send: Send) -> Send:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", []), *HEADERS]}
            await send(message)

        return sending
