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

from hapticd.client import Client, RequestRefused, stop_channel
from hapticd.record import RecordingError
from hapticd.service import socket as control_socket
from hapticd.service.api import ApiServer
from hapticd.service.daemon import Daemon
from hapticd.servo.authority import Command, Withdrawn
from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home, wait_for_state

pytestmark = pytest.mark.realtime
__all__ = ["state_home"]

START = b"POST /start HTTP/1.1\r\nHost: hapticd\r\nContent-Type: application/json\r\nContent-Length: 2\r\n%s\r\n{}"
SET = b'{"settings": {"spring.origin": 0.1}}'
COMMANDS: list[Command] = []
"""All that have arrived."""


@contextmanager
def served(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[tuple[Daemon, Client, Any]]:
    """A daemon whose shaft stands off the origin, its API, and the device."""
    path = tmp_path / "h.sock"
    with daemon_on(monkeypatch, tmp_path, lambda n: 100) as (daemon, opened):
        arrived = daemon.authority.arrived
        monkeypatch.setattr(
            daemon.authority, "arrived", lambda *given: COMMANDS.append(arrived(*given)) or COMMANDS[-1]
        )
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


def test_a_start_that_waits_in_the_queue_does_not_outlive_a_stop(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        arrived = len(COMMANDS)
        go_on = held(daemon)
        waiting = ask(client.socket_path, START % b"")
        wait_until(lambda: len(COMMANDS) > arrived, "the start has arrived")
        assert client.stop()["state"] == "off"
        go_on()
        assert b"stopped before it began" in answer_to(waiting)
        stays_off(daemon, device)


def test_a_start_whose_client_has_gone_does_not_begin(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        arrived = len(COMMANDS)
        go_on = held(daemon)
        waiting = ask(client.socket_path, START % b"")
        wait_until(lambda: len(COMMANDS) > arrived, "the start has arrived")
        waiting.close()
        go_on()
        stays_off(daemon, device)


def test_a_setting_whose_client_has_gone_moves_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, _):
        client.start()
        arrived, before = len(COMMANDS), daemon.config()
        go_on = held(daemon)
        head = b"POST /set HTTP/1.1\r\nHost: h\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n"
        waiting = ask(client.socket_path, head % len(SET) + SET)
        wait_until(lambda: len(COMMANDS) > arrived, "the setting has arrived")
        waiting.close()
        go_on()
        client.set({"spring.stiffness": 0.011})  # carried out after it
        assert daemon.config()["spring"]["origin"] == before["spring"]["origin"]


@contextmanager
def frozen(daemon: Daemon, client: Client, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The API's event loop hangs."""
    go_on, hangs = threading.Event(), threading.Event()

    def halt(name: str) -> Any:
        hangs.set()
        go_on.wait(20.0)
        raise RuntimeError(name)

    with monkeypatch.context() as broken:
        broken.setattr(daemon, "halt", halt)
        hanging = ask(client.socket_path, b"POST /stop HTTP/1.1\r\nHost: hapticd\r\nContent-Length: 0\r\n\r\n")
        hangs.wait(20.0)
        try:
            yield
        finally:
            go_on.set()
            hanging.close()


@pytest.mark.parametrize("says", ["when it was sent", "nothing"])
@pytest.mark.parametrize("word", ["stop", "estop"])
def test_what_lies_in_a_socket_while_the_channel_is_heard_does_not_outlive_the_stop(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, word: stop_channel.Word, says: str
) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        daemon.estop()
        time.sleep(0.2)
        with frozen(daemon, client, monkeypatch):
            head = b"" if says == "nothing" else b"Request-Sent-Ns: %d\r\n" % time.monotonic_ns()
            asked = [ask(client.socket_path, START.replace(b"/start", name) % head) for name in (b"/clear", b"/start")]
            time.sleep(0.2)
            assert stop_channel.ask(client.socket_path, word, 5.0) in ("off", "fault")
        for connection in asked:
            assert b"stopped before it began" in answer_to(connection)
        assert daemon.status()["fault"]["code"] == "estop"
        stays_off(daemon, device)


def test_who_does_not_say_when_it_was_sent_may_start_after_a_stop(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, _):
        assert stop_channel.ask(client.socket_path, "stop", 5.0) == "off"
        time.sleep(0.5)
        asked = ask(client.socket_path, START % b"")
        wait_for_state(daemon, "running")
        asked.close()


@pytest.mark.parametrize("fails", ["the disk", "a stop"])
@pytest.mark.parametrize("experiment", ["release", "excite"])
def test_of_an_experiment_that_did_not_begin_nothing_is_left_for_the_next_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, experiment: str, fails: str
) -> None:
    with served(monkeypatch, tmp_path) as (daemon, _, _):
        before = daemon.rig.origin_counts
        starts = daemon.rig.recorder.start

        def start(path: Any, label: str) -> Any:
            if fails == "the disk":
                raise RecordingError("no room")
            daemon.authority.stop()
            return starts(path, label)

        ask_for = {"release": lambda: daemon.release(3.0, 0.5), "excite": lambda: daemon.excite("steps")}[experiment]
        with monkeypatch.context() as broken:
            broken.setattr(daemon.rig.recorder, "start", start)
            with pytest.raises((RecordingError, Withdrawn)):
                ask_for()
        daemon.start()
        wait_for_state(daemon, "running")
        request = daemon.rig.request
        assert (request.excitation_id, request.excitation_length, request.exact) == (0, 0, False)
        assert daemon.rig.origin_counts == before


def test_a_start_begins_within_its_deadline_or_not_at_all(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        past = b"Request-Deadline-Ns: %d\r\n" % (time.monotonic_ns() - 1)
        assert b"after its deadline; send it again" in answer_to(ask(client.socket_path, START % past))
        stays_off(daemon, device)


def test_what_was_answered_with_an_error_never_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Today's executor cannot fail to make a thread; whatever else fails between queue and answer is like it."""
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        kept: list[Callable[[], Any]] = []

        def queue_and_fail(pool: Any, method: Callable[[], Any]) -> Any:
            kept.append(method)
            raise RuntimeError("can't start new thread")

        arrived = len(COMMANDS)
        with monkeypatch.context() as broken:
            broken.setattr("asyncio.base_events.BaseEventLoop.run_in_executor", lambda _, p, m: queue_and_fail(p, m))
            with pytest.raises(RequestRefused) as refused:
                client.start()
        assert refused.value.status == 500
        assert len(COMMANDS) > arrived
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


@pytest.mark.parametrize(("word", "state"), [("stop", "off"), ("estop", "fault")])
def test_the_stop_channel_needs_no_api(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, word: stop_channel.Word, state: str
) -> None:
    """The event loop hangs, the command thread hangs, and there is no descriptor left."""
    with served(monkeypatch, tmp_path) as (daemon, client, device):
        client.start()
        wait_for_state(daemon, "running")
        go_on = held(daemon)
        with frozen(daemon, client, monkeypatch):
            assert stop_channel.ask(client.socket_path, word, 10.0) == state
            stays_off(daemon, device)
        go_on()


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
