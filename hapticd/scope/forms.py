"""The form of a request: its body, its fields, and which page asks."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from starlette.requests import Request

MAX_BODY_BYTES = 64 * 1024
JSON_TYPE = "application/json"
CLIENT = re.compile(r"[A-Za-z0-9_-]{8,64}")
DEEPEST = 16
_NESTING = re.compile(r"""[\[\]{}]|"(?:[^"\\]|\\.)*+"?""", re.DOTALL)
"""A bracket, or a text as a whole, ended or not: brackets in it are none. Possessive, so that nothing is read twice."""


class BadRequest(Exception):  # noqa: N818 - becomes an answer
    """The request is refused for its form, or for what was typed.

    Attributes:
        status, code, message: of the answer. problems: ``key`` and ``message`` of each field that is wrong.
    """

    def __init__(self, status: int, code: str, message: str, problems: Sequence[Mapping[str, str]] = ()) -> None:
        super().__init__(message)
        self.status, self.code, self.message, self.problems = status, code, message, problems


async def body_of(request: Request, media_type: str, limit: int) -> bytes:
    """The request's body.

    Raises:
        BadRequest: of another media type, or longer than the limit.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != media_type:
        raise BadRequest(415, "media_type", f"a body of type {media_type} is needed, not {kind or 'none'}")
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > limit:
            raise BadRequest(413, "too_large", f"the body is longer than {limit} bytes")
    return bytes(body)


def read_json(text: str) -> Any:
    """What a page says, in JSON.

    Raises:
        ValueError: it is none, or lists and objects lie in each other more than `DEEPEST` deep: the parser calls itself for
            each, and would end in a RecursionError.
    """
    depth = 0
    for found in _NESTING.finditer(text):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(found[0], 0)
        if depth > DEEPEST:
            raise ValueError(f"lists and objects lie in each other more than {DEEPEST} deep")
    return json.loads(text, parse_constant=_no_constant)


async def fields_of(request: Request, **kinds: type) -> dict[str, Any]:
    """The request's JSON object, with exactly these fields.

    Raises:
        BadRequest: it is none, or a field is missing, unknown or of another type.
    """
    try:
        found = read_json((await body_of(request, JSON_TYPE, MAX_BODY_BYTES)).decode())
    except ValueError as error:
        raise BadRequest(400, "json", f"the body is not valid JSON: {error}") from error
    if not isinstance(found, dict) or found.keys() != kinds.keys():
        raise BadRequest(
            422, "request", f"a JSON object with exactly the fields {', '.join(kinds) or '(none)'} is needed"
        )
    for name, kind in kinds.items():
        value = found[name]
        numeric = kind is float and isinstance(value, int | float) and not isinstance(value, bool)
        if not (numeric or isinstance(value, kind)):
            raise BadRequest(422, "request", f"{name}: {value!r:.60} is not of the right type ({kind.__name__})")
    return found


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number of JSON")


def client_of(request: Request) -> str:
    """The page that asks, by the name it has given itself.

    Raises:
        BadRequest: it has given itself none.
    """
    client = request.headers.get("x-client", "")
    if not CLIENT.fullmatch(client):
        raise BadRequest(422, "request", "an X-Client header is needed")
    return client
