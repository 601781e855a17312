"""The compiled listener: what it obeys, whom it answers, what it says without a loop, and its end."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapticd.servo import authority, layout
from hapticd.servo.authority import Authority
from hapticd.servo.core import Request, parameters
from hapticd.servo.stop_channel import StopChannel
from hapticd.servo.thread import ServoThread
from tests.polling import PATIENCE_S, wait_until
from tests.servo.scripted import Scripted, config, fault_code

PRIORITY = 1


@contextlib.contextmanager
def listening(given: Authority, path: Path) -> Iterator[StopChannel]:
    """The channel on a socket."""
    channel = StopChannel(given.words, PRIORITY)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as bound:
        bound.bind(str(path))
        channel.listen(bound)
        try:
            yield channel
        finally:
            channel.end()
    assert not channel.alive()


@contextlib.contextmanager
def asking(path: Path, *, has_address: bool = True) -> Iterator[socket.socket]:
    """Somebody who asks."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asker:
        asker.settimeout(PATIENCE_S)
        if has_address:
            asker.bind("")
        asker.connect(str(path))
        yield asker


@contextlib.contextmanager
def running(given: Authority) -> Iterator[ServoThread]:
    """A loop in real time that renders in the name of a command."""
    cfg = config(safety={"heartbeat_timeout_s": 10.0}, servo={"overrun": {"fault_after": None}})
    driver = Scripted(cfg, lambda n: 100)
    driver.open()
    servo = ServoThread(cfg, driver, parameters(cfg, Request()), words=given.words)
    servo.start()
    try:
        command = given.arrived(PATIENCE_S)

        def publish(ordinal: int) -> None:
            servo.core.publish(parameters(cfg, Request(state=layout.RUNNING, ordinal=ordinal)))

        command.begin(publish)
        wait_until(lambda: any(current for current, _ in driver.commands), "current")
        yield servo
    finally:
        servo.stop()
        driver.close()


@pytest.mark.parametrize(("word", "answer", "fault"), [(b"stop", b"off", None), (b"estop", b"fault", "estop")])
def test_who_asks_is_told_the_state_once_the_current_is_zero(
    word: bytes, answer: bytes, fault: str | None, tmp_path: Path
) -> None:
    given, path = Authority(), tmp_path / "stop"
    with running(given) as servo, listening(given, path), asking(path) as asker:
        asker.send(word)
        assert asker.recv(16) == answer
        assert float(servo.core.snapshot["current"]) == 0.0
        assert fault_code(servo.core) == fault
    assert given.load(authority.ESTOPS) == (fault is not None)


def test_a_stop_of_what_is_in_a_fault_says_so(tmp_path: Path) -> None:
    given, path = Authority(), tmp_path / "stop"
    with running(given), listening(given, path), asking(path) as asker:
        for word in (b"estop", b"stop"):
            asker.send(word)
            assert asker.recv(16) == b"fault"


def test_who_has_no_address_is_obeyed_and_not_answered(tmp_path: Path) -> None:
    given, path = Authority(), tmp_path / "stop"
    command = given.arrived(PATIENCE_S)
    with listening(given, path), asking(path, has_address=False) as silent, asking(path) as asker:
        silent.send(b"estop")
        wait_until(command.is_revoked, "the command is revoked")
        wait_until(lambda: given.load(authority.ESTOPS) == 1, "the estop is counted")
        asker.send(b"stop")  # and the listener goes on
        assert asker.recv(16) == b"late"


JUNK = [b"", b"s", b"sto", b"stop\n", b"STOP", b"stopx", b"estop ", b"\0" * 8, b"x" * 5000, b"stop" * 1000]


def test_junk_is_no_stop_and_ends_nothing(tmp_path: Path) -> None:
    given, path = Authority(), tmp_path / "stop"
    command = given.arrived(PATIENCE_S)
    with listening(given, path) as channel, asking(path) as asker:
        for junk in JUNK:
            asker.send(junk)
        asker.settimeout(0.3)
        with pytest.raises(TimeoutError):
            asker.recv(16)
        assert not command.is_revoked()
        assert channel.alive()
        asker.settimeout(PATIENCE_S)
        asker.send(b"stop")
        assert asker.recv(16) == b"late"
    assert command.is_revoked()
    assert given.load(authority.ESTOPS) == 0


def test_zeros_behind_the_word_are_no_part_of_it(tmp_path: Path) -> None:
    """As a program in C may send it."""
    given, path = Authority(), tmp_path / "stop"
    with listening(given, path), asking(path) as asker:
        asker.send(b"estop".ljust(32, b"\0"))
        assert asker.recv(16) == b"late"
    assert given.load(authority.ESTOPS) == 1


def test_without_a_loop_it_stops_and_says_late(tmp_path: Path) -> None:
    """What it revoked stays revoked for the loop that comes."""
    given, path = Authority(), tmp_path / "stop"
    command = given.arrived(PATIENCE_S)
    with listening(given, path), asking(path) as asker:
        asker.send(b"estop")
        assert asker.recv(16) == b"late"
    assert command.is_revoked()


def test_an_asker_that_has_gone_is_no_trouble(tmp_path: Path) -> None:
    given, path = Authority(), tmp_path / "stop"
    with listening(given, path), asking(path) as stays:
        with asking(path) as goes:
            goes.send(b"stop")
        stays.send(b"stop")
        assert stays.recv(16) == b"late"


def test_it_ends_without_a_socket_and_twice() -> None:
    channel = StopChannel(Authority().words, PRIORITY)
    assert channel.alive()
    channel.end()
    channel.end()
    assert not channel.alive()
