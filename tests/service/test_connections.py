"""How many connections the daemon holds, of whom, and for how long."""

from __future__ import annotations

import contextlib
import logging
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapticd.client import Client, RequestRefused
from hapticd.control import connections
from hapticd.control.descriptors import Seldom
from hapticd.control.endpoints import JsonDict
from hapticd.service import access, guests
from hapticd.service.access import Caller, Rules
from hapticd.service.api import ApiServer
from hapticd.service.socket import bind
from tests.polling import PATIENCE_S, wait_until
from tests.service.fake_control import FakeControl
from tests.service.strangers import as_nobody, connect_often, needs_root, open_folder

CONTROL, WATCH = 5001, 5002
REQUEST = b"GET /status HTTP/1.1\r\nHost: h\r\n"


@contextlib.contextmanager
def served(path: Path, rules: Rules | None = None, mode: int = 0o660) -> Iterator[Client]:
    server = ApiServer(FakeControl(), bind(path, mode), rules)
    server.start()
    yield Client(path)
    server.stop()


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Client]:
    with served(tmp_path / "h.sock") as client:
        yield client


def connected(client: Client) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(str(client.socket_path))  # one that has a time-out would not wait for a place in the queue
    connection.settimeout(PATIENCE_S)
    return connection


def is_closed(connection: socket.socket) -> bool:
    """Whether the other end closes it, at last."""
    try:
        while connection.recv(4096):
            pass
    except ConnectionResetError:
        pass
    return True


@pytest.mark.parametrize("says", [b"", b"G", REQUEST])
def test_who_does_not_say_what_he_wants_is_let_go(client: Client, says: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HEAD_S", 0.3)
    began = time.monotonic()
    with connected(client) as connection:
        connection.sendall(says)
        assert is_closed(connection)
    assert time.monotonic() - began >= connections.HEAD_S


def test_a_further_request_has_its_deadline_too(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HEAD_S", 0.3)
    with connected(client) as connection:
        connection.sendall(REQUEST + b"\r\n")
        assert connection.recv(65536).startswith(b"HTTP/1.1 200 ")
        connection.sendall(b"GET")
        assert is_closed(connection)


def test_who_is_answered_slowly_is_not_let_go(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HEAD_S", 0.3)

    def slow(control: FakeControl) -> JsonDict:
        time.sleep(connections.HEAD_S + 0.5)
        return {"state": "off"}

    monkeypatch.setattr(FakeControl, "status", slow)
    assert client.status() == {"state": "off"}


def test_the_oldest_that_is_silent_goes_and_a_newcomer_is_served(client: Client) -> None:
    with connected(client) as answered, contextlib.ExitStack() as ending:
        answered.sendall(REQUEST + b"\r\n")
        assert answered.recv(65536).startswith(b"HTTP/1.1 200 ")
        made = [ending.enter_context(connected(client)) for _ in range(guests.OWN + 8)]
        assert client.status()["state"] == "off"
        assert is_closed(made[0])
        made[-1].sendall(REQUEST + b"Connection: close\r\n\r\n")
        assert made[-1].recv(65536).startswith(b"HTTP/1.1 200 ")


def test_a_stream_that_is_read_is_not_silent(client: Client) -> None:
    with connected(client) as stream, contextlib.ExitStack() as ending:
        stream.sendall(b"GET /stream HTTP/1.1\r\nHost: h\r\n\r\n")
        assert stream.recv(4096).startswith(b"HTTP/1.1 200 ")
        made = [ending.enter_context(connected(client)) for _ in range(guests.OWN + 8)]
        assert is_closed(made[0])
        stream.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            assert stream.recv(65536) != b"", "the stream has been closed"


def test_one_user_is_in_nobody_elses_way(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    with contextlib.ExitStack() as ending:
        own = ending.enter_context(connected(client))
        wait_until(lambda: client.status()["state"] == "off", "it has been accepted")
        monkeypatch.setattr(access, "caller_of", lambda connection: Caller(1, 64_000, frozenset({CONTROL})))
        made = [ending.enter_context(connected(client)) for _ in range(guests.OTHERS + 1)]
        assert is_closed(made[0])
        own.sendall(REQUEST + b"Connection: close\r\n\r\n")
        assert own.recv(65536).startswith(b"HTTP/1.1 200 ")


@needs_root
def test_who_has_no_role_is_let_go_at_once_and_told_why() -> None:
    with open_folder() as folder, served(folder / "h.sock", Rules(CONTROL, WATCH), 0o666) as client:

        def ask() -> str:
            with pytest.raises(RequestRefused) as told:
                client.stop()
            return f"{told.value.status} {told.value}"

        with as_nobody(ask) as said:
            assert said.decode().startswith("403 uid 65534 has no role here")
        before = _descriptors()
        with as_nobody(lambda: connect_often(client.socket_path, 500)) as said:
            assert said == b"500"
            wait_until(lambda: _descriptors() <= before + 8, "none of them is held")


def _descriptors() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def test_the_soft_limit_of_descriptors_is_raised_and_no_lower_one_set() -> None:
    code = """
import resource as r
from hapticd.control.descriptors import prepare
hard = r.getrlimit(r.RLIMIT_NOFILE)[1]
r.setrlimit(r.RLIMIT_NOFILE, (64, hard)); prepare(100); prepare(50); print(r.getrlimit(r.RLIMIT_NOFILE) == (100, hard))
r.setrlimit(r.RLIMIT_NOFILE, (64, 70)); prepare(); print(r.getrlimit(r.RLIMIT_NOFILE) == (70, 70))
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE_S)
    assert found.stdout == "True\nTrue\n"
    assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] > 100


def test_the_same_line_is_logged_seldom_and_counted() -> None:
    now = [0.0]
    seldom = Seldom(10.0, lambda: now[0])
    logger, told = logging.Logger("of this test"), list[str]()
    handler = logging.Handler()
    handler.emit = lambda record: told.append(record.getMessage())  # type: ignore[method-assign]
    logger.addHandler(handler)
    logger.addFilter(seldom)
    for at in range(1001):
        now[0] = at / 100
        logger.error("no descriptor for %s", at)
        if at == 500:
            logger.error("something else")
    assert told == ["no descriptor for 0", "something else", "no descriptor for 1000\n(999 more like this before it)"]
