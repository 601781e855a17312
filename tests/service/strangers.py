"""Another user's process, which connects and says nothing; for root alone, who can become somebody else."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.polling import PATIENCE_S

NOBODY = 65534
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="another user is needed: run as root")


@contextlib.contextmanager
def open_folder() -> Iterator[Path]:
    """A folder that every user may enter; pytest's own may not be."""
    with tempfile.TemporaryDirectory(prefix="hd-") as name:
        Path(name).chmod(0o755)
        yield Path(name)


@contextlib.contextmanager
def many_descriptors(count: int = 4096) -> Iterator[None]:
    """This process may have so many; the test is skipped where it may not."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < count:
        pytest.skip(f"at most {hard} descriptors")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, count), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@contextlib.contextmanager
def as_nobody(act: Callable[[], object]) -> Iterator[bytes]:
    """Do something in a process of another user, which then stays; yields what it returned, as text."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
            os.write(writer, str(act()).encode())
            time.sleep(10 * PATIENCE_S)
        finally:
            os._exit(0)
    os.close(writer)
    try:
        said = os.read(reader, 4096)
        yield said
    finally:
        os.close(reader)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


_HELD: list[socket.socket] = []
"""Of this process, until it ends."""


def connect_often(path: Path, count: int, says: bytes = b"") -> int:
    """So many connections, each of which says so much, or as many as can be had: it tries again where the queue is full.

    Returns:
        How many there are; they stay until the process ends.
    """
    deadline = time.monotonic() + PATIENCE_S / 3
    while len(_HELD) < count and time.monotonic() < deadline:
        connection = socket.socket(socket.AF_UNIX)
        connection.setblocking(False)
        try:
            connection.connect(str(path))
        except BlockingIOError:
            connection.close()
            time.sleep(0.005)
            continue
        _HELD.append(connection)
        with contextlib.suppress(OSError):
            connection.send(says)
    return len(_HELD)
