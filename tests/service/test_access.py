"""Who may ask for what, over a real socket; who a caller is comes from the kernel, or from the test in its place."""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapticd.client import Client, RequestRefused
from hapticd.control.endpoints import endpoint_of
from hapticd.service import access
from hapticd.service.access import Caller, Rules, caller_of
from hapticd.service.api import ApiServer
from hapticd.service.daemon import refuse_outside
from hapticd.service.refusals import Refused
from hapticd.service.socket import bind
from tests.service.fake_control import FakeControl

CONTROL, WATCH, OTHER = 5001, 5002, 5003
STRANGER = 64_000
RULES = Rules(CONTROL, WATCH)


def stranger(*groups: int) -> Caller:
    return Caller(1234, STRANGER, frozenset(groups))


@pytest.fixture
def control() -> FakeControl:
    return FakeControl()


@pytest.fixture
def client(control: FakeControl, tmp_path: Path) -> Iterator[Client]:
    server = ApiServer(control, bind(tmp_path / "h.sock"), RULES)
    server.start()
    yield Client(tmp_path / "h.sock")
    server.stop()


def test_the_kernel_says_who_is_at_the_other_end() -> None:
    here, there = socket.socketpair(socket.AF_UNIX)
    with here, there:
        found = caller_of(here)
    assert (found.pid, found.uid) == (os.getpid(), os.geteuid())
    assert found.groups == {os.getegid(), *os.getgroups()}
    assert found.is_own_user


def test_roles_follow_the_groups() -> None:
    assert RULES.role(stranger(OTHER, CONTROL)) == "control"
    assert RULES.role(stranger(WATCH)) == "watch"
    assert RULES.role(stranger(CONTROL, WATCH)) == "control"
    assert RULES.role(stranger(OTHER)) is None
    assert RULES.role(Caller(1, 0, frozenset())) == "control"
    assert RULES.role(Caller(1, os.geteuid(), frozenset())) == "control"
    assert Rules().role(stranger()) == "control", "without roles the socket's permissions decide"


def test_who_watches_looks_and_moves_nothing(
    client: Client, control: FakeControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(access, "caller_of", lambda connection: stranger(WATCH))
    assert client.status()["state"] == "off"
    assert client.config()["servo"]["rate_hz"] == 1000
    for command in (client.start, client.clear, client.stop, client.estop, client.record_start):
        with pytest.raises(RequestRefused, match=f"uid {STRANGER} may only watch: POST /.* is for the group") as caught:
            command()
        assert (caught.value.status, caught.value.code) == (403, "forbidden")
    assert control.calls == []
    assert control.state == "off"


def test_who_is_refused_while_still_sending_is_told_why(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access, "caller_of", lambda connection: stranger(WATCH))
    body = b"{}"
    head = "POST /start HTTP/1.1\r\nHost: h\r\nContent-Type: application/json\r\nConnection: close\r\n"
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(10.0)
        connection.connect(str(client.socket_path))
        connection.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode())
        time.sleep(0.2)
        connection.sendall(body)
        assert connection.recv(4096).startswith(b"HTTP/1.1 403 ")


def test_who_has_no_role_gets_nothing(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access, "caller_of", lambda connection: stranger(OTHER))
    with pytest.raises(RequestRefused, match="has no role here"):
        client.status()


def test_an_unknown_caller_gets_nothing(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody_knows(connection: socket.socket) -> Caller:
        raise OSError

    monkeypatch.setattr(access, "caller_of", nobody_knows)
    with pytest.raises(RequestRefused, match="the caller is unknown"):
        client.status()


def test_the_log_says_who_asked_for_what(
    client: Client, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "hapticd.api")
    monkeypatch.setattr(access, "caller_of", lambda connection: stranger(CONTROL))
    client.start(force=True)
    client.set({"spring.stiffness": 0.02})
    client.clear()
    client.stop()
    client.status()
    told = [record.getMessage() for record in caplog.records if record.name == "hapticd.api"]
    assert told == [
        f"uid {STRANGER}, pid 1234: start(force=True)",
        f"uid {STRANGER}, pid 1234: set(settings={{'spring.stiffness': 0.02}})",
        f"uid {STRANGER}, pid 1234: clear()",
        f"uid {STRANGER}, pid 1234: stop()",
    ]
    assert caplog.records[0].journal == {"uid": STRANGER, "pid": 1234, "request": "start"}


def test_only_the_own_user_is_trusted_with_a_path(
    client: Client, control: FakeControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.record_start("/r/a.arrow")
    monkeypatch.setattr(access, "caller_of", lambda connection: stranger(CONTROL))
    client.record_start("/r/a.arrow")
    assert control.calls == [("record_start", "/r/a.arrow", "trusted"), ("record_start", "/r/a.arrow")]


def test_nobody_says_of_himself_that_he_is_trusted(client: Client, control: FakeControl) -> None:
    with pytest.raises(RequestRefused, match="trusted") as caught:
        client.send(endpoint_of(Client.record_start), {"path": "/etc/x", "trusted": True})
    assert caught.value.status == 422
    assert control.calls == []


def test_a_recording_stays_inside_its_directory_whatever_the_path_says(tmp_path: Path) -> None:
    runs, elsewhere = tmp_path / "runs", tmp_path / "elsewhere"
    runs.mkdir()
    elsewhere.mkdir()
    (runs / "link").symlink_to(elsewhere)
    refuse_outside(runs / "a.arrow", runs)
    refuse_outside(runs / "deep" / "a.arrow", runs)
    for path in (elsewhere / "a.arrow", runs / ".." / "a.arrow", runs / "link" / "a.arrow", tmp_path / "runs-2" / "a"):
        with pytest.raises(Refused, match=r"is outside record\.directory"):
            refuse_outside(path, runs)
