"""How the daemon says that it cannot do what it was asked for."""

from __future__ import annotations


class Refused(Exception):  # noqa: N818 - an answer, not an error of the program
    """The daemon understood and says no, in its present state (HTTP 409)."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message


class DriverFailure(Exception):  # noqa: N818 - named as the public exit code is: "device or driver failure"
    """The device or its driver failed while a request was carried out (HTTP 502)."""
