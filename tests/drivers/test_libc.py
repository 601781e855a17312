"""The C library behind compiled exchanges: waiting, datagrams, and errors as ``-errno``."""

from __future__ import annotations

import errno
import select
import socket
import time

import numpy as np

from drivers import libc

SCRATCH = np.zeros(libc.SCRATCH, np.int64)


def test_clock_is_monotonic_time() -> None:
    before = time.monotonic_ns()
    assert before <= libc.now_ns(SCRATCH) <= time.monotonic_ns()


def test_waiting_ends_at_the_instant_or_with_data_or_with_the_peer() -> None:
    ours, peer = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        begin = time.monotonic_ns()
        assert libc.wait_until(SCRATCH, ours.fileno(), libc.POLLIN, begin + 20_000_000) == 0
        assert time.monotonic_ns() >= begin + 20_000_000
        peer.send(b"x")
        assert libc.wait_until(SCRATCH, ours.fileno(), libc.POLLIN, begin + 60_000_000_000) == select.POLLIN
        ours.recv(1)
        peer.close()
        assert libc.wait_until(SCRATCH, ours.fileno(), libc.POLLIN, 0) & select.POLLHUP
    assert libc.wait_until(SCRATCH, 999_999, libc.POLLIN, 0) == select.POLLNVAL


def test_datagrams_and_errors() -> None:
    ours, peer = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    block = np.arange(4, dtype=np.int64)
    with ours:
        assert libc.receive(ours.fileno(), block.ctypes.data, 16) == -errno.EAGAIN
        assert libc.send(ours.fileno(), block.ctypes.data, 16) == 16
        assert peer.recv(64) == block[:2].tobytes()
        peer.send(b"abc")
        assert libc.receive(ours.fileno(), block.ctypes.data, 16) == 3
        assert block.tobytes()[:3] == b"abc"
        peer.close()
        assert libc.receive(ours.fileno(), block.ctypes.data, 16) == 0
        assert libc.send(ours.fileno(), block.ctypes.data, 16) == -errno.EPIPE
    assert libc.send(999_999, block.ctypes.data, 16) == -errno.EBADF
