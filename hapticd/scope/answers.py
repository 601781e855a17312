"""Answers of the scope's server: JSON in the control API's one error shape."""

from __future__ import annotations

from typing import Any

import pydantic_core
from starlette.responses import Response


def to_json(content: Any) -> bytes:
    """``content`` as JSON; numbers that JSON has no form for are ``null``."""
    return pydantic_core.to_json(content, inf_nan_mode="null", fallback=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


def answer(content: Any, status: int = 200) -> Response:
    """A JSON answer."""
    return Response(to_json(content), status, media_type="application/json")


def error_answer(status: int, code: str, message: str, **more: Any) -> Response:
    """``{"error": {"code", "message", …}}``."""
    return answer({"error": {"code": code, "message": message, **more}}, status)
