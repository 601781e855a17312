"""Answers and errors as JSON; all errors have the same form.

JSON has no non-finite numbers: an unknown velocity is sent as ``null``.
"""

from __future__ import annotations

import json
from typing import Any

import pydantic_core
from starlette.responses import JSONResponse


def to_json(content: Any) -> bytes:
    """JSON with numpy scalars and paths as plain values, and non-finite numbers as ``null``."""
    try:
        return pydantic_core.to_json(content, inf_nan_mode="null", fallback=_plain)
    except pydantic_core.PydanticSerializationError:
        # A lone surrogate, quoted from a request, is not valid UTF-8: it is escaped.
        plain = pydantic_core.to_jsonable_python(content, inf_nan_mode="null", fallback=_plain)
        return json.dumps(plain, allow_nan=False).encode()


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


class JsonReply(JSONResponse):
    """A reply written by `to_json`."""

    def render(self, content: Any) -> bytes:
        """Serialise ``content``."""
        return to_json(content)


def error_reply(status: int, code: str, message: str, **more: Any) -> JsonReply:
    """The form of every error: ``{"error": {"code", "message", …}}``."""
    return JsonReply({"error": {"code": code, "message": message, **more}}, status_code=status)
