"""Connections that have not shown a token yet: few at a time, so that they never stand in front of a page's stop."""

from __future__ import annotations

from typing import Final, cast

from starlette.requests import HTTPConnection

from hapticd.control.connections import LEAVE, Crowd, LimitedProtocol

STRANGERS: Final = 64


class StrangerProtocol(LimitedProtocol):
    """HTTP; whoever connects is a stranger first."""

    strangers: Crowd

    def crowd(self) -> Crowd:
        """The one of all strangers."""
        return self.strangers


def strangers(limit: int = STRANGERS) -> type[StrangerProtocol]:
    """The protocol of a server with so many strangers at a time."""
    return cast(type[StrangerProtocol], type("StrangerProtocol", (StrangerProtocol,), {"strangers": Crowd(limit)}))


def has_token(connection: HTTPConnection) -> None:
    """Whoever asks is no stranger any more: a request or a WebSocket has shown a token that is right."""
    connection.scope["state"][LEAVE]()
