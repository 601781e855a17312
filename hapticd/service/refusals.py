"""Exceptions with which the daemon refuses or fails a request."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class Refused(Exception):  # noqa: N818 - an answer, not an error of the program
    """A valid request is refused in the daemon's present state (HTTP 409).

    Attributes:
        code, message: of the answer.
        choice: for a user interface: ``reason`` (the message without the remedy), ``remedies`` (changes, each of which is
            sufficient) and ``force`` (whether ``force`` overrides the refusal).
    """

    def __init__(self, code: str, message: str, choice: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.choice = dict(choice or {})


class DriverFailure(Exception):  # noqa: N818 - named as the public exit code is: "device or driver failure"
    """The device or its driver failed while a request was executed (HTTP 502)."""
