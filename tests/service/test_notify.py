"""What systemd hears: readiness, reloads, and a watchdog that only a ticking loop feeds."""

from __future__ import annotations

import socket
from collections.abc import Iterator
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
    notifier = Notifier(manager.getsockname())
    notifier.ready()
    notifier.status("off, 1000 Hz")
    notifier.status("off, 1000 Hz")
    notifier.stopping()
    assert heard(manager) == ["READY=1", "STATUS=off, 1000 Hz", "STOPPING=1"]


def test_a_reload_says_since_when(manager: socket.socket) -> None:
    Notifier(manager.getsockname()).reloading()
    (message,) = heard(manager)
    lines = dict(line.split("=") for line in message.splitlines())
    assert lines["RELOADING"] == "1"
    assert int(lines["MONOTONIC_USEC"]) > 0


def test_an_abstract_address() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0hapticd-test-notify")
        Notifier("@hapticd-test-notify").ready()
        assert listener.recv(100) == b"READY=1"


def test_the_watchdog_starves_with_the_loop(manager: socket.socket) -> None:
    ticks = 0
    watchdog = TickWatchdog(Notifier(manager.getsockname(), watchdog_s=5.0), lambda: ticks)
    fed = []
    for step in range(200):  # 10 s, a look every 50 ms
        if step < 100:
            ticks += 50
        fed.append(watchdog.look(step * 0.05))
    assert sum(fed[:100]) == 5
    assert not any(fed[101:])
    assert heard(manager) == ["WATCHDOG=1"] * 5


def test_without_a_manager_nothing_is_sent_and_nothing_fails(tmp_path: Path) -> None:
    Notifier(None, watchdog_s=1.0).feed()
    Notifier(str(tmp_path / "nobody")).ready()
    assert not TickWatchdog(Notifier(None, 1.0), lambda: 1).look(0.0)


def test_a_watchdog_of_another_process_is_not_ours(monkeypatch: pytest.MonkeyPatch, manager: socket.socket) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", manager.getsockname())
    monkeypatch.setenv("WATCHDOG_USEC", "5000000")
    monkeypatch.setenv("WATCHDOG_PID", "1")
    assert Notifier.from_environment().watchdog_s is None
    monkeypatch.delenv("WATCHDOG_PID")
    assert Notifier.from_environment().watchdog_s == 5.0
