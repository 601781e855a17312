"""The OpenAPI document: complete, and the committed copy is the current one."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hapticd.control.endpoints import Endpoints, declared
from hapticd.control.schemas import body_of
from hapticd.service.api import create_app

from .fake_control import FakeControl

COMMITTED = Path(__file__).parents[2] / "docs" / "reference" / "openapi.json"


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return create_app(FakeControl()).openapi()


def operations(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield f"{method.upper()} {path}", operation


def test_committed_document_is_current(document: dict[str, Any]) -> None:
    assert json.loads(COMMITTED.read_text(encoding="utf-8")) == document, "run: python -m docs.make_pages"


def test_every_endpoint_is_there(document: dict[str, Any]) -> None:
    assert {name for name, _ in operations(document)} == {
        "GET /status",
        "GET /config",
        "GET /metrics",
        "GET /experiment",
        "GET /stream",
        "POST /start",
        "POST /stop",
        "POST /estop",
        "POST /clear",
        "POST /set",
        "POST /origin",
        "POST /release",
        "POST /excite",
        "POST /sequence",
        "POST /record/start",
        "POST /record/stop",
        "POST /note",
        "POST /marker",
        "POST /reload",
    }


def test_every_endpoint_is_described_and_says_how_it_fails(document: dict[str, Any]) -> None:
    for name, operation in operations(document):
        assert operation["description"], name
        if name.startswith("POST") and name not in ("POST /estop", "POST /stop"):
            for status in ("400", "409", "413", "422"):
                schema = operation["responses"][status]["content"]["application/json"]["schema"]
                assert schema == {"$ref": "#/components/schemas/ErrorReply"}, name


def test_every_field_of_every_body_is_described() -> None:
    bodies = [body for endpoint in declared(Endpoints) if (body := body_of(endpoint))]
    assert len(bodies) == 12
    for body in bodies:
        assert body.__doc__
        for name, field in body.model_fields.items():
            assert field.description, f"{body.__name__}.{name}"
