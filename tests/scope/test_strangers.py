"""Connections without a token stand in nobody's way: not in front of a stop, not in the log."""

from __future__ import annotations

import contextlib
import json
import logging
import resource
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from hapticd.scope.forms import DEEPEST, read_json
from hapticd.scope.hub import WAITING_MESSAGES
from hapticd.scope.sockets import MAX_CONNECTIONS
from hapticd.scope.strangers import STRANGERS
from tests.polling import PATIENCE_S, wait_until
from tests.service import fake_control
from tests.service.fake_control import FakeControl
from tests.service.strangers import many_descriptors

from .served import CLIENT, Served
from .test_command import launched

MANY = 1100


def silent(scope: Served, count: int, says: bytes = b"") -> contextlib.AbstractContextManager[list[socket.socket]]:
    """Connections that say so much and no more."""
    return silent_at(scope.port, count, says)


@contextlib.contextmanager
def silent_at(port: int, count: int, says: bytes = b"") -> Iterator[list[socket.socket]]:
    """The same, to a port."""
    with contextlib.ExitStack() as ending:
        made = []
        for _ in range(count):
            connection = ending.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE_S))
            made.append(connection)
            with contextlib.suppress(OSError):
                connection.sendall(says)
        yield made


def is_closed(connection: socket.socket) -> bool:
    connection.settimeout(PATIENCE_S)
    try:
        while connection.recv(4096):
            pass
    except ConnectionResetError:
        pass
    return True


def page(scope: Served, name: str = "state") -> Any:
    return connect(f"ws://127.0.0.1:{scope.port}/ws/{name}", origin=scope.origin, open_timeout=20)  # type: ignore[arg-type]


def greeted(scope: Served) -> bool:
    """Whether a page that comes now is served."""
    with page(scope) as connection:
        connection.send(json.dumps({"token": scope.access.control_token, "client": CLIENT}))
        return "lease" in json.loads(connection.recv(timeout=20))


@pytest.mark.parametrize("says", [b"", b"G", b"POST /api/stop HTTP/1.1\r\nHost: x\r\n"])
def test_a_stop_comes_through_a_thousand_strangers(
    scope: Served, control: FakeControl, caplog: pytest.LogCaptureFixture, says: bytes
) -> None:
    with many_descriptors(), silent(scope, MANY, says):
        assert scope.post("stop").status_code == 200
        assert greeted(scope)
    assert control.calls == [("stop",)]
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING] == []


def test_a_process_with_few_descriptors_stops_all_the_same(tmp_path: Path, control: FakeControl) -> None:
    """With the limit that systemd gives, which cannot be raised here."""
    with (
        many_descriptors(),
        fake_control.serve(control, tmp_path / "h.sock"),
        launched(tmp_path, "--json") as (process, output, errors),
    ):
        wait_until(lambda: "pid" in output.read_text(), "the URLs")
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (1024, 1024))
        url, token = json.loads(output.read_text())["url"].split("#")
        with silent_at(urlsplit(url).port or 0, MANY):
            reply = httpx.post(f"{url}api/stop", headers={"Authorization": f"Bearer {token}"}, timeout=PATIENCE_S)
            assert reply.status_code == 200
        assert control.calls == [("stop",)]
        assert errors.read_text() == ""


def test_of_strangers_there_are_few_and_the_oldest_goes(scope: Served) -> None:
    with silent(scope, 2 * STRANGERS) as made:
        assert is_closed(made[0])
        newest = made[-1]
        newest.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{scope.port}\r\nConnection: close\r\n\r\n".encode())
        newest.settimeout(PATIENCE_S)
        assert newest.recv(4096).startswith(b"HTTP/1.1 200 ")


def test_whoever_has_shown_a_token_is_no_stranger(scope: Served) -> None:
    with page(scope) as connection:
        connection.send(json.dumps({"token": scope.access.control_token, "client": CLIENT}))
        connection.recv(timeout=20)
        with silent(scope, 2 * STRANGERS) as made:
            assert is_closed(made[0])
            for _ in range(2 * WAITING_MESSAGES):  # more than can have been under way
                connection.recv(timeout=20)


def test_websockets_that_say_nothing_take_no_page_its_place(scope: Served) -> None:
    with contextlib.ExitStack() as ending:
        for _ in range(MAX_CONNECTIONS + 1):
            ending.enter_context(page(scope))
        assert greeted(scope)


def test_pages_with_a_token_are_limited(scope: Served) -> None:
    hello = json.dumps({"token": scope.access.view_token, "client": CLIENT})
    with contextlib.ExitStack() as ending:
        for _ in range(MAX_CONNECTIONS):
            connection = ending.enter_context(page(scope, "rows"))
            connection.send(hello)
        wait_until(lambda: scope.server.connections == MAX_CONNECTIONS, "all of them are served")
        with page(scope) as last:
            last.send(hello)
            with pytest.raises(ConnectionClosed) as closed:
                last.recv(timeout=20)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4429
    wait_until(lambda: scope.server.connections == 0, "an idle scope")


@pytest.mark.parametrize("text", ["[" * 4000, '{"a":' * 800, '{"token": ' + "[" * 2000 + "]" * 2000 + "}"])
def test_what_is_nested_deep_is_refused_before_the_token(
    scope: Served, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    with page(scope) as connection:
        connection.send(text)
        with pytest.raises(ConnectionClosed) as closed:
            connection.recv(timeout=20)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4401
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING] == []


def test_what_is_nested_deep_is_refused_after_it_too(scope: Served, control: FakeControl) -> None:
    scope.post("lease", {"take": True})
    body: Any = 1
    for _ in range(DEEPEST):
        body = [body]
    reply = scope.post("set", {"settings": {"spring.stiffness": body}})
    assert (reply.status_code, reply.json()["error"]["code"]) == (400, "json")
    assert f"more than {DEEPEST} deep" in reply.json()["error"]["message"]
    assert control.calls == []


def test_brackets_in_a_text_are_none() -> None:
    deep = "[" * 100
    assert read_json(json.dumps({"a": deep, f'\\"{deep}': [deep]})) == {"a": deep, f'\\"{deep}': [deep]}
    for wrong in ('"' + deep, '{"a": NaN}', "", '"\\'):
        with pytest.raises(ValueError):  # noqa: PT011 - whichever of the parser's texts
            read_json(wrong)
