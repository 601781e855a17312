"""Admission to the control socket, and the number of connections per user (`hapticd.control.connections`)."""

from __future__ import annotations

from typing import Final, cast

from hapticd.control.connections import Crowd, Crowds, LimitedProtocol
from hapticd.control.json_reply import error_reply
from hapticd.service.access import Caller, CallerProtocol, Rules, Turns

OTHERS: Final = 32
"""Most connections of a user at a time."""
OWN: Final = 128
"""The same for root and the daemon's own user."""


class GuestProtocol(LimitedProtocol, CallerProtocol):
    """HTTP for callers with a role; other connections get an answer 403 and are closed before any request is read."""

    rules: Rules
    crowds: Crowds

    def crowd(self) -> Crowd | None:
        """The connections of the caller's user."""
        caller: Caller | None = self.app_state.get("caller")
        if caller is None or self.rules.role(caller) is None:
            who = "the caller is unknown" if caller is None else f"uid {caller.uid} has no role here"
            self._turn_away(f"{who}; roles are given to the groups api.group and api.watch_group of the config")
            return None
        return self.crowds.of(caller.uid, OWN if caller.is_own_user else OTHERS)

    def _turn_away(self, why: str) -> None:
        body = bytes(error_reply(403, "forbidden", why).body)
        head = f"HTTP/1.1 403 Forbidden\r\nContent-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        self.transport.write(head.encode() + b"Connection: close\r\n\r\n" + body)
        self.transport.close()


def guests(rules: Rules, turns: Turns) -> type[GuestProtocol]:
    """The protocol of a server with these rules and the iterations of its event loop."""
    own = {"rules": rules, "crowds": Crowds(), "turns": turns}
    return cast(type[GuestProtocol], type("GuestProtocol", (GuestProtocol,), own))
