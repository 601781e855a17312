"""What systemd hears: readiness, reloads, and a watchdog that only a ticking loop feeds."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from hapticd.service.notify import Notifier, TickWatchdog


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.setblocking(False)
        yield listener


def heard(manager: socket.socket) -> list[str]:
    messages = []
    while True:
        try:
            messages.append(manager.recv(4096).decode())
        except BlockingIOError:
            return messages


def test_each_word_is_one_datagram(manager: socket.socket) -> None:
    with closing(Notifier(manager.getsockname())) as notifier:
        notifier.ready()
        notifier.status("off, 1000 Hz")
        notifier.status("off, 1000 Hz")
        notifier.stopping()
    assert heard(manager) == ["READY=1", "STATUS=off, 1000 Hz", "STOPPING=1"]


def test_a_reload_says_since_when(manager: socket.socket) -> None:
    with closing(Notifier(manager.getsockname())) as notifier:
        notifier.reloading()
    (message,) = heard(manager)
    lines = dict(line.split("=") for line in message.splitlines())
    assert lines["RELOADING"] == "1"
    assert int(lines["MONOTONIC_USEC"]) > 0


def test_an_abstract_address() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0hapticd-test-notify")
        with closing(Notifier("@hapticd-test-notify")) as notifier:
            notifier.ready()
        assert listener.recv(100) == b"READY=1"


def test_the_watchdog_starves_with_the_loop(manager: socket.socket) -> None:
    ticks = 0
    fed = []
    with closing(Notifier(manager.getsockname(), watchdog_s=5.0)) as notifier:
        watchdog = TickWatchdog(notifier, lambda: ticks)
        for step in range(200):  # 10 s, a look every 50 ms
            if step < 100:
                ticks += 50
            fed.append(watchdog.look(step * 0.05))
    assert sum(fed[:100]) == 5
    assert not any(fed[101:])
    assert heard(manager) == ["WATCHDOG=1"] * 5


def test_no_message_needs_a_descriptor(manager: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> socket.socket:
        raise OSError(errno.EMFILE, "Too many open files")

    with closing(Notifier(manager.getsockname())) as notifier:
        monkeypatch.setattr(socket, "socket", refused)
        notifier.stopping()
        notifier.feed()
    assert heard(manager) == ["STOPPING=1", "WATCHDOG=1"]


def test_a_manager_that_reads_nothing_keeps_nobody_waiting_and_hears_the_rest_when_it_does(
    manager: socket.socket,
) -> None:
    with closing(Notifier(manager.getsockname())) as notifier:
        for _ in range(10_000):
            notifier.feed()
        notifier.ready()
        notifier.status("running, 1000 Hz")
        assert set(heard(manager)) == {"WATCHDOG=1"}
        notifier.status("running, 1000 Hz")
        notifier.status("running, 1000 Hz")
    assert heard(manager) == ["READY=1", "STATUS=running, 1000 Hz"]


def test_without_a_manager_nothing_is_sent_and_nothing_fails(tmp_path: Path) -> None:
    Notifier(None, watchdog_s=1.0).feed()
    with closing(Notifier(str(tmp_path / "nobody"))) as notifier:
        notifier.ready()
    assert not TickWatchdog(Notifier(None, 1.0), lambda: 1).look(0.0)


def test_a_watchdog_of_another_process_is_not_ours(monkeypatch: pytest.MonkeyPatch, manager: socket.socket) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", manager.getsockname())
    monkeypatch.setenv("WATCHDOG_USEC", "5000000")
    monkeypatch.setenv("WATCHDOG_PID", "1")
    with closing(Notifier.from_environment()) as notifier:
        assert notifier.watchdog_s is None
    monkeypatch.delenv("WATCHDOG_PID")
    with closing(Notifier.from_environment()) as notifier:
        assert notifier.watchdog_s == 5.0
