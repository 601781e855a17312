"""How answers and errors look on the wire: JSON always, in one error shape.

Non-finite numbers have no JSON form; a velocity that is not known yet is sent as ``null``.
"""

from __future__ import annotations

import json
from typing import Any

import pydantic_core
from starlette.responses import JSONResponse


def to_json(content: Any) -> bytes:
    """JSON in which numpy scalars and paths are plain values, and non-finite numbers ``null``."""
    try:
        return pydantic_core.to_json(content, inf_nan_mode="null", fallback=_plain)
    except pydantic_core.PydanticSerializationError:
        # A lone surrogate, which JSON can escape and UTF-8 cannot hold: quoted from a request, it goes back escaped.
        plain = pydantic_core.to_jsonable_python(content, inf_nan_mode="null", fallback=_plain)
        return json.dumps(plain, allow_nan=False).encode()


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


class JsonReply(JSONResponse):
    """A reply as `to_json` writes it."""

    def render(self, content: Any) -> bytes:
        """Serialise ``content``."""
        return to_json(content)


def error_reply(status: int, code: str, message: str, **more: Any) -> JsonReply:
    """The one shape of an error: ``{"error": {"code", "message", …}}``."""
    return JsonReply({"error": {"code": code, "message": message, **more}}, status_code=status)
