"""The daemon where nobody reads what it says, and where its terminal goes away: it stops, latches, answers all the same."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.polling import PATIENCE_S, wait_until
from tests.service.processes import Rig, rig
from tests.service.test_sink import fill

__all__ = ["rig"]

pytestmark = pytest.mark.realtime


@contextmanager
def full_terminal(folder: Path) -> Iterator[Path]:
    """A terminal whose window shows nothing any more."""
    master, slave = os.openpty()
    try:
        fill(slave)
        yield Path(os.ttyname(slave))
    finally:
        os.close(master)
        os.close(slave)


@contextmanager
def full_pipe(folder: Path) -> Iterator[Path]:
    """A pipe with a reader that does not read."""
    path = folder / "pipe"
    os.mkfifo(path)
    end = os.open(path, os.O_RDWR)
    try:
        fill(end)
        yield path
    finally:
        os.close(end)


@contextmanager
def unread(folder: Path) -> Iterator[Path]:
    """A socket that takes datagrams until it is full."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(folder / "unread"))
        yield folder / "unread"


def stream_of(path: Path) -> str:
    """What systemd puts into $JOURNAL_STREAM."""
    found = path.stat()
    return f"{found.st_dev}:{found.st_ino}"


@pytest.mark.parametrize(("sink", "journal"), [(full_terminal, False), (full_pipe, False), (full_pipe, True)])
def test_nothing_hangs_where_nobody_reads(rig: Rig, sink: Callable[[Path], Iterator[Path]], journal: bool) -> None:
    with sink(rig.folder) as output, unread(rig.folder) as manager:  # type: ignore[attr-defined]
        variables = {"NOTIFY_SOCKET": str(manager), "TERM": "xterm"}
        if journal:
            variables["JOURNAL_STREAM"] = stream_of(output)
        process = rig.launch(output=output, **variables)
        rig.render()
        rig.client.estop()
        wait_until(lambda: any((rig.folder / "state").rglob("fault-*.json")), "the latched fault")
        assert rig.client.clear()["state"] == "off"
        assert rig.client.set({"spring.stiffness": 0.011})["applied"] == {"spring.stiffness": 0.011}
        rig.render()
        assert rig.client.stop()["state"] == "off"
        rig.render()
        process.terminate()
        assert process.wait(PATIENCE_S) == 0
    rig.check_end()


def test_a_log_that_is_read_again_says_what_it_lost(rig: Rig) -> None:
    with full_pipe(rig.folder) as output:
        process = rig.launch(output=output)
        # Each is a line of the log.
        while not (lost := rig.client.status()["log_lines_dropped"]):
            rig.client.set({"spring.stiffness": 0.011})
        assert f"hapticd_log_dropped_lines_total {lost}.0\n" in rig.client.metrics()
        reader = os.open(output, os.O_RDONLY)
        found = b""
        while b" are lost: they were not read in time\n" not in found:
            found += os.read(reader, 1 << 16)
        os.close(reader)
        (line,) = (line for line in found.decode().splitlines() if "are lost" in line)
        assert line.startswith(f"WARNING {lost} lines")
        process.terminate()
        assert process.wait(PATIENCE_S) == 0


ON_TERMINAL = "tests.service.on_terminal:main"


def test_a_closed_window_ends_the_daemon_at_zero_current(rig: Rig) -> None:
    master, slave = os.openpty()
    process = rig.launch(ON_TERMINAL, Path(os.ttyname(slave)))
    rig.render()
    os.close(slave)
    os.close(master)
    assert process.wait(PATIENCE_S) == 0
    rig.check_end()


def test_the_keys_of_a_terminal_leave_no_current(rig: Rig) -> None:
    """Ctrl-Z stops the motor and does not freeze the daemon; Ctrl-backslash ends it by way of zero current."""
    master, slave = os.openpty()
    process = rig.launch(ON_TERMINAL, Path(os.ttyname(slave)), TERM="xterm")
    rig.render()
    said = b""
    os.write(master, b"\x1a")
    while b"suspended, it would supervise nothing" not in b" ".join(said.split()):
        said += os.read(master, 1 << 16)
    assert rig.client.status()["state"] == "off"
    rig.render()
    os.write(master, b"\x1c")
    while b"recorded    " not in said:
        said += os.read(master, 1 << 16)
    assert process.wait(PATIENCE_S) == 0
    assert b"the thread MainThread is at" in said
    rig.check_end()
    os.close(master)
    os.close(slave)


def test_a_hangup_that_is_ignored_from_the_start_stays_so(rig: Rig) -> None:
    """As nohup leaves it."""
    master, slave = os.openpty()
    process = rig.launch("tests.service.on_terminal:nohup", Path(os.ttyname(slave)))
    rig.render()
    process.send_signal(signal.SIGHUP)
    rig.client.set({"spring.stiffness": 0.011})
    assert rig.client.status()["state"] == "running"
    process.terminate()
    assert process.wait(PATIENCE_S) == 0
    os.close(master)
    os.close(slave)
