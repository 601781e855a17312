"""After an acknowledged stop nothing that was asked for before it moves the motor, whatever queues, threads, clients do."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hapticd.client import Client, RequestRefused
from hapticd.service import socket as control_socket
from hapticd.service.api import ApiServer
from hapticd.service.daemon import Daemon
from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home, wait_for_state

pytestmark = pytest.mark.realtime
__all__ = ["state_home"]

START = b"POST /start HTTP/1.1\r\nHost: hapticd\r\nContent-Type: application/json\r\nContent-Length: 2\r\n%s\r\n{}"


@contextmanager
def served(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[tuple[Daemon, Client, Any]]:
    """A daemon whose shaft stands off the origin, its API, and the device."""
    path = tmp_path / "h.sock"
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, opened):
        server = ApiServer(daemon, control_socket.bind(path))
        server.start()
        channel = control_socket.bind(control_socket.stop_path(path), kind=socket.SOCK_DGRAM)
        daemon.stop_channel.listen(channel.socket)
        try:
            yield daemon, Client(path), opened[0]
        finally:
            daemon.disable()
            server.stop()
            daemon.stop_channel.end()
            channel.close()


def held(daemon: Daemon) -> Callable[[], None]:
    """Hold the daemon's lock, as a reload does, until what is returned is called."""
    release, has_it = threading.Event(), threading.Event()

    def hold() -> None:
        with daemon._lock:
            has_it.set()
            release.wait(30.0)

    threading.Thread(target=hold, daemon=True).start()
    has_it.wait(30.0)
    return release.set


def ask(path: Path, request: bytes) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(str(path))
    connection.sendall(request)
    return connection


def answer_to(connection: socket.socket) -> bytes:
    """All of a short answer."""
    connection.settimeout(10.0)
    text = b""
    while b'"error"' not in text:
        text += connection.recv(4096)
    connection.close()
    return text


def stays_off(daemon: Daemon, device: Any) -> None:
    """No current was commanded since the last zero, and none comes."""
    wait_until(lambda: daemon.status()["state"] in ("off", "fault"), "off")
    before = len(device.commands)
    wait_until(lambda: len(device.commands) > before + 50, "further ticks")
    assert not any(current for current, _ in device.commands[before:])


def given(daemon: Daemon) -> int:
    return int(daemon.authority.words[0])


def test_a_start_that_waits_in_the_queue_does_not_outlive_a_stop(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        ordinal = given(daemon)
        go_on = held(daemon)
        waiting = ask(client.socket_path, START % b"")
        wait_until(lambda: given(daemon) > ordinal, "the start has arrived")
        assert client.stop()["state"] == "off"
        go_on()
        assert b"stopped before it began" in answer_to(waiting)
        stays_off(daemon, device)


def test_a_start_whose_client_has_gone_does_not_begin(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        ordinal = given(daemon)
        go_on = held(daemon)
        waiting = ask(client.socket_path, START % b"")
        wait_until(lambda: given(daemon) > ordinal, "the start has arrived")
        waiting.close()
        go_on()
        stays_off(daemon, device)


def test_a_start_begins_within_its_deadline_or_not_at_all(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        past = b"Request-Deadline-Ns: %d\r\n" % (time.monotonic_ns() - 1)
        assert b"after its deadline; ask again" in answer_to(ask(client.socket_path, START % past))
        stays_off(daemon, device)


def test_what_was_answered_with_an_error_never_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Today's executor cannot fail to make a thread; whatever else fails between queue and answer is like it."""
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        kept: list[Callable[[], Any]] = []

        def queue_and_fail(pool: Any, method: Callable[[], Any]) -> Any:
            kept.append(method)
            raise RuntimeError("can't start new thread")

        ordinal = given(daemon)
        with monkeypatch.context() as broken:
            broken.setattr("asyncio.base_events.BaseEventLoop.run_in_executor", lambda _, p, m: queue_and_fail(p, m))
            with pytest.raises(RequestRefused) as refused:
                client.start()
        assert refused.value.status == 500
        assert given(daemon) > ordinal
        with pytest.raises(Exception, match="answered before it began"):
            kept[0]()
        client.set({"spring.stiffness": 0.011})
        stays_off(daemon, device)


def test_no_thread_is_made_after_the_start(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        asked: list[str] = []

        def refuse(thread: threading.Thread) -> None:
            asked.append(thread.name)
            raise RuntimeError("can't start new thread")

        monkeypatch.setattr(threading.Thread, "start", refuse)
        client.start()
        wait_for_state(daemon, "running")
        assert client.stop()["state"] == "off"
        client.release(1.0, 0.2)
        wait_until(lambda: client.experiment()["state"] == "done", "the end of the release")
        client.start()
        assert client.estop()["state"] == "fault"
        stays_off(daemon, device)
        assert client.clear()["state"] == "off"
        client.start()
        assert client.stop()["state"] == "off"
        assert asked == []


@pytest.mark.parametrize(("word", "state"), [(b"stop", "off"), (b"estop", "fault")])
def test_the_stop_channel_needs_no_api(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, word: bytes, state: str
) -> None:
    """The event loop hangs, the command thread hangs, and there is no descriptor left."""
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        client.start()
        wait_for_state(daemon, "running")
        go_on = held(daemon)
        frozen = threading.Event()
        monkeypatch.setattr(daemon, "halt", lambda name: frozen.wait(20.0))
        hanging = ask(client.socket_path, b"POST /stop HTTP/1.1\r\nHost: hapticd\r\nContent-Length: 0\r\n\r\n")
        sender = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        sender.bind("")
        sender.settimeout(10.0)
        sender.sendto(word, str(control_socket.stop_path(client.socket_path)))
        assert sender.recv(64) == state.encode()
        stays_off(daemon, device)
        frozen.set()
        go_on()
        hanging.close()
        sender.close()


def test_the_recording_of_a_run_that_the_channel_stopped_is_closed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, _):
        client.start()
        sender = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        sender.sendto(b"stop", str(control_socket.stop_path(client.socket_path)))
        sender.close()
        wait_until(lambda: daemon.status()["recorder"]["state"] == "off", "the end of the recording")
        assert daemon.status()["state"] == "off"


def test_an_estop_while_the_rig_is_replaced_is_for_the_new_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with served(monkeypatch, tmp_path) as (daemon, _, _):
        old = daemon.rig
        with daemon._lock:  # as a reload has it
            old.close()
            daemon.authority.estop()
            daemon._replacement._put(old.config, 0, known=True)
        assert wait_for_state(daemon, "fault")["fault"]["code"] == "estop"
