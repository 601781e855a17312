"""How the daemon says that it cannot do what it was asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class Refused(Exception):  # noqa: N818 - an answer, not an error of the program
    """The daemon understood and says no, in its present state (HTTP 409).

    Attributes:
        code, message: of the answer.
        choice: for who offers it as a choice: ``reason`` (the message without what to do about it), ``remedies`` (changes
            that are enough, one by one) and ``force`` (whether it can be asked for all the same).
    """

    def __init__(self, code: str, message: str, choice: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.choice = dict(choice or {})


class DriverFailure(Exception):  # noqa: N818 - named as the public exit code is: "device or driver failure"
    """The device or its driver failed while a request was carried out (HTTP 502)."""
