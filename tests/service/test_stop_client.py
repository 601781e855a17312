"""A stop as its client asks for it: the stop channel first, the API for the full answer, and the truth about both."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from hapticd.client import Client, DaemonUnreachable, StoppedUnanswered, stop_channel, stop_on_interrupt
from tests.service.fake_control import FakeControl, serve
from tests.service.stop_listener import mute_api
from tests.service.stop_listener import stop_channel as channel_at
from tests.service.strangers import as_nobody, needs_root, open_folder

PATH = "h.sock"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / PATH


@pytest.mark.parametrize("word", ["stop", "estop"])
def test_the_word_arrives_and_the_answer_comes_back(path: Path, word: stop_channel.Word) -> None:
    with channel_at(path, b"off") as heard:
        assert stop_channel.ask(path, word) == "off"
    assert heard == [word.encode()]


def test_no_channel_is_no_answer(path: Path) -> None:
    assert stop_channel.ask(path, "stop") is None
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as left:
        left.bind(f"{path}.stop")
    assert stop_channel.ask(path, "stop") is None
    with channel_at(path.with_name("other"), None):
        assert stop_channel.ask(path.with_name("other"), "stop", 0.05) is None


def test_a_channel_whose_queue_is_full_is_given_up(path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.bind(f"{path}.stop")
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as flood:
            flood.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                for _ in range(100_000):
                    flood.sendto(b"stop", f"{path}.stop")
        assert stop_channel.ask(path, "stop", 0.05) is None


def test_nobody_else_can_say_that_it_is_off(path: Path) -> None:
    """A name that the kernel has chosen is open to everybody; the answer is the channel's alone."""
    refused: list[bool] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.bind(f"{path}.stop")

        def listen() -> None:
            _, sender = channel.recvfrom(64)
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as liar:
                try:
                    liar.sendto(b"off", sender)
                    refused.append(False)
                except PermissionError:
                    refused.append(True)

        thread = threading.Thread(target=listen)
        thread.start()
        assert stop_channel.ask(path, "stop", 0.5) is None
        thread.join()
    assert refused == [True]


def test_both_ways_are_gone_and_the_report_is_the_apis(path: Path) -> None:
    control = FakeControl()
    with serve(control, path) as client, channel_at(path, b"off") as heard:
        assert client.stop()["state"] == "off"
        assert client.estop()["fault"]["code"] == "estop"
        client.status()
    assert heard == [b"stop", b"estop"]
    assert control.calls == [("stop",), ("estop",)]


@pytest.mark.parametrize("state", ["off", "fault"])
def test_a_stop_that_was_obeyed_is_one_though_the_api_is_silent(path: Path, state: str) -> None:
    with mute_api(path), channel_at(path, state.encode()), pytest.raises(StoppedUnanswered) as told:
        Client(path, timeout_s=0.1).stop()
    assert told.value.state == state
    assert str(told.value).startswith(f"{state}: zero current; the API did not answer: the daemon on {path} accepts")


@pytest.mark.parametrize(
    ("answer", "said"), [(b"late", "the servo loop does not obey"), (None, "the stop channel does not answer either")]
)
def test_a_stop_that_nobody_confirms_says_so(path: Path, answer: bytes | None, said: str) -> None:
    with mute_api(path), channel_at(path, answer), pytest.raises(DaemonUnreachable) as told:
        Client(path, timeout_s=0.1).stop()
    assert not isinstance(told.value, StoppedUnanswered)
    assert str(told.value).endswith(f"{said}: to be sure, cut the power of the amplifier")


def test_whoever_is_not_there_is_told_apart(path: Path) -> None:
    def said() -> str:
        with pytest.raises(DaemonUnreachable) as told:
            Client(path, timeout_s=0.1).stop()
        return str(told.value)

    start = "start one with 'hapticd run'"
    assert said() == f"no daemon answers on {path}; {start}"
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))
    assert said() == f"no daemon answers on {path}, which is left from one that has ended; {start}"
    path.unlink()
    path.write_text("")
    assert said() == f"no daemon answers on {path}, which is not a socket; {start}"


def test_a_full_queue_is_no_missing_daemon(path: Path) -> None:
    with mute_api(path, backlog=0), socket.socket(socket.AF_UNIX) as first:
        first.connect(str(path))
        with pytest.raises(DaemonUnreachable, match=r"runs but has accepted no connection for 0\.1 s"):
            Client(path, timeout_s=0.1).status()


def test_a_full_queue_is_asked_again(path: Path) -> None:
    """A Unix socket refuses at once where TCP would wait: the client waits in its place."""
    with socket.socket(socket.AF_UNIX) as listening, socket.socket(socket.AF_UNIX) as first:
        listening.bind(str(path))
        listening.listen(0)
        first.connect(str(path))

        def answer_later() -> None:
            time.sleep(0.1)
            listening.accept()[0].close()
            peer, _ = listening.accept()
            with peer:
                peer.recv(4096)
                peer.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}")

        thread = threading.Thread(target=answer_later)
        thread.start()
        assert Client(path, timeout_s=20).status() == {}
        thread.join()


@needs_root
def test_who_may_not_is_told_who_may() -> None:
    with open_folder() as folder:
        place = folder / PATH

        def ask() -> str:
            with pytest.raises(DaemonUnreachable) as told:
                Client(place, timeout_s=0.1).stop()
            return str(told.value)

        with mute_api(place):
            place.chmod(0o660)
            with as_nobody(ask) as said:
                owner = f"(owner 0, group {os.getegid()}, mode 0660)"
                told = f"no permission to use the daemon on {place} {owner}; ask to be added to its group"
                assert said.decode() == told


def test_a_command_carries_its_deadline_and_a_query_none(path: Path) -> None:
    heads: list[bytes] = []
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        listening.listen()

        def listen() -> None:
            for _ in range(2):
                peer, _ = listening.accept()
                with peer:
                    heads.append(peer.recv(4096).partition(b"\r\n\r\n")[0].lower())
                    peer.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}")

        thread = threading.Thread(target=listen)
        thread.start()
        before = time.monotonic_ns()
        client = Client(path, timeout_s=7.0)
        client.start()
        after = time.monotonic_ns()
        client.status()
        thread.join()
    fields: dict[str, Any] = dict(line.split(": ") for line in heads[0].decode().split("\r\n")[1:])
    assert before + 7_000_000_000 <= int(fields["request-deadline-ns"]) <= after + 7_000_000_000
    assert b"request-deadline-ns" not in heads[1]


def test_ctrl_c_stops_by_the_channel_where_the_api_is_silent(path: Path) -> None:
    said: list[str] = []
    client = Client(path, timeout_s=0.1)
    with (
        mute_api(path),
        channel_at(path, b"off") as heard,
        pytest.raises(KeyboardInterrupt),
        stop_on_interrupt(client, said.append),
    ):
        raise KeyboardInterrupt
    assert heard == [b"stop"]
    assert said[0].startswith("off: zero current; the API did not answer")


def test_the_command_says_it_and_ends_with_0(
    path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from hapticd.cli.main import main

    monkeypatch.setattr("hapticd.client.client.STOPPED_TIMEOUT_S", 0.1)
    with mute_api(path), channel_at(path, b"fault") as heard:
        assert main(["stop", "--socket", str(path)]) == 0
        assert capsys.readouterr().out.startswith("fault: zero current; the API did not answer: ")
        assert main(["estop", "--socket", str(path), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["state"] == "fault"
    assert heard == [b"stop", b"estop"]
