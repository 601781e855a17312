"""Error replies: all have the same form (`hapticd.control.json_reply`), and never a traceback."""

from __future__ import annotations

import difflib
import json
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import asdict
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from hapticd.config import ConfigError
from hapticd.control.json_reply import error_reply
from hapticd.record import RecordingError
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.servo.authority import Withdrawn
from hapticd.servo.excitation import ExcitationError

MAX_BODY_BYTES = 64 * 1024
UNLIMITED_PATHS = frozenset({"/estop", "/stop"})
"""A stop is never refused because of its body, which is not read."""

ANSWERS = (Refused, Withdrawn, ConfigError, ExcitationError, DriverFailure, RecordingError)
"""Exceptions that are answers to a request; any other exception is an internal error."""

LONGEST_QUOTE = 60


class Internal(Exception):  # noqa: N818 - carries no text of its own on purpose
    """An unexpected exception in the daemon; its traceback is in the log, not in the reply."""


def install(app: FastAPI, bodies: Mapping[str, type[BaseModel]]) -> None:
    """Register the body limit and a handler for every exception of a request.

    Args:
        app: the application.
        bodies: path to body model, whose fields are listed in the error about an unknown field.
    """

    def answer(status: int, code: str, text: str = "") -> Callable[[Request, Exception], Awaitable[Response]]:
        async def handler(_: Request, error: Exception) -> Response:
            return error_reply(status, code, text or str(error))

        return handler

    async def refused(_: Request, error: Exception) -> Response:
        assert isinstance(error, Refused)
        return error_reply(409, error.code, error.message, **error.choice)

    async def withdrawn(_: Request, error: Exception) -> Response:
        assert isinstance(error, Withdrawn)
        return error_reply(409, error.code, str(error))

    async def config(_: Request, error: Exception) -> Response:
        assert isinstance(error, ConfigError)
        return error_reply(422, "config", str(error), problems=[asdict(problem) for problem in error.problems])

    async def invalid(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        first = error.errors()[0]
        if first["type"] == "json_invalid":
            reason = first.get("ctx", {}).get("error", "")
            return error_reply(400, "json", f"the body is not valid JSON: {reason} at character {first['loc'][-1]}")
        fields = bodies[request.url.path].model_fields if request.url.path in bodies else {}
        return error_reply(422, "request", "; ".join(describe(problem, list(fields)) for problem in error.errors()))

    async def http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if error.status_code == 404:
            return error_reply(404, "not_found", f"no such path: {request.url.path}; /openapi.json lists them all")
        if error.status_code == 405:
            reply = error_reply(405, "method", f"{request.method} is not the method of {request.url.path}")
            reply.headers.update(error.headers or {})  # Allow, as RFC 9110 demands
            return reply
        if error.status_code == 400:
            return error_reply(400, "json", "the body cannot be read as JSON")
        return error_reply(error.status_code, "request", str(error.detail))

    for kind, handler in (
        (Refused, refused),
        (Withdrawn, withdrawn),
        (ConfigError, config),
        (ExcitationError, answer(422, "excitation")),
        (DriverFailure, answer(502, "driver")),
        (RecordingError, answer(409, "recording")),
        (Internal, answer(500, "internal", "internal error of the daemon; its log has the details")),
        (RequestValidationError, invalid),
        (HTTPException, http),
    ):
        app.add_exception_handler(kind, handler)
    app.add_middleware(BodyLimit)


def describe(problem: Mapping[str, Any], fields: list[str]) -> str:
    """One sentence about a problem that pydantic found in a body."""
    where = ".".join(str(part) for part in problem["loc"][1:])
    kind, value = problem["type"], problem.get("input")
    if kind == "extra_forbidden":
        nearest = difflib.get_close_matches(where, fields, n=1)
        hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
        return f"unknown field {where!r}{hint} (fields: {', '.join(fields) or 'none'})"
    if kind == "missing":
        return f"missing field {where!r}" if where else "a JSON body is needed (Content-Type: application/json)"
    if not where:
        return "the body must be a JSON object (Content-Type: application/json)"
    message = problem["msg"][:1].lower() + problem["msg"][1:]
    if kind == "rule" and isinstance(value, list):  # its message names the wrong element
        return f"{where}: {message}"
    return f"{where}: {message}, got {quote(value)}"


def quote(value: Any) -> str:
    """``value`` as JSON (with NaN and Infinity), cut to a readable length."""
    text = json.dumps(value, default=str)
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}…"


class BodyLimit:
    """Reads the body before the application, up to a limit, also without a Content-Length."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 413 to a body beyond the limit, pass everything else on."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        body = b""
        more = scope["path"] not in UNLIMITED_PATHS
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                return
            body += message.get("body", b"")
            more = message.get("more_body", False)
            if len(body) > MAX_BODY_BYTES:
                reply = error_reply(413, "too_large", f"the body is longer than {MAX_BODY_BYTES} bytes")
                await reply(scope, receive, send)
                return
        pending = [{"type": "http.request", "body": body, "more_body": False}]

        async def replay() -> Message:
            return pending.pop() if pending else await receive()

        await self.app(scope, replay, send)
