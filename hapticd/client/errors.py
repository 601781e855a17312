"""What can go wrong between a client and a daemon."""

from __future__ import annotations

from typing import Any


class DaemonUnreachable(Exception):  # noqa: N818 - named as the public exit code is: "daemon not reachable"
    """Nobody answers on the socket, or not in time; the text says where and how to start a daemon."""


class RequestRefused(Exception):  # noqa: N818 - an answer, not an error of the program
    """The daemon answered, and not with yes.

    Attributes:
        status: HTTP status: 409 refused in this state, 422 wrong request or config, 502 device failure.
        code: short stable name of the reason.
        message: sentence for people.
        problems: one dict for each wrong setting, for code ``config``.
    """

    def __init__(self, status: int, code: str, message: str, problems: list[dict[str, Any]] | None = None) -> None:
        super().__init__(message)
        self.status = status
        self.code = code
        self.message = message
        self.problems = problems or []
