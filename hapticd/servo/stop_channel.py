"""Second channel for a stop: a compiled listener on a datagram socket, without GIL, API, allocation or descriptor.

``stop`` or ``estop`` in a datagram sets the authority's words (`hapticd.servo.authority`), which the tick reads. When the
loop has obeyed, the reply to the sender, if it has an address, is the name of the state, or ``late`` after 0.1 s. Everybody
with write permission on the socket's file may send.
"""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.libc import POLLIN, SCRATCH, now_ns, receive_from, send_to, wait_until
from hapticd.jit import atomic_load, atomic_store, njit
from hapticd.servo import authority, layout
from hapticd.servo.realtime import block_signals, name_thread, set_scheduler

if TYPE_CHECKING:
    import socket

    from numpy.typing import NDArray


def _word(text: str) -> int:
    return int.from_bytes(text.encode(), "little")


_STOP, _ESTOP, _LATE = _word("stop"), _word("estop"), _word("late")
_STATES = tuple(_word(name) for name in layout.STATE_NAMES)
_OBEYED_NS: Final = 100_000_000
_LOOK_NS: Final = 200_000_000
_POLL_NS: Final = 20_000
_TICKS: Final = 2
"""The present tick may already have read the words; the next one has not."""

# Memory of the listener, words.
_QUIT, _MESSAGE, _SENDER_SIZE, _REPLY, _SENDER = 0, 1, 2, 3, 4
_ROOM: Final = 128
"""Bytes of a sender's address; a ``struct sockaddr_un`` has 110."""
_MEMORY: Final = _SENDER + _ROOM // 8


@njit("int64(int64[::1], int64[::1], boolean)", counted=False)
def _obeyed(words: NDArray[Any], scratch: NDArray[Any], faults: bool) -> int:
    """Wait until the loop has executed the request; its mode, or -1."""
    ticks, since = atomic_load(words, authority.LOOP_TICKS), now_ns(scratch)
    while True:
        done, mode = atomic_load(words, authority.LOOP_TICKS), atomic_load(words, authority.LOOP_MODE)
        if done >= ticks + _TICKS and (mode == layout.FAULT or (mode == layout.OFF and not faults)):
            return int(mode)
        now = now_ns(scratch)
        if now > since + _OBEYED_NS:
            return -1
        wait_until(scratch, -1, 0, now + _POLL_NS)


@njit("void(int64, int64[::1], int64[::1], int64[::1])", counted=False)
def _listen(descriptor: int, words: NDArray[Any], memory: NDArray[Any], scratch: NDArray[Any]) -> None:
    """Obey datagrams until `_QUIT` is set."""
    address = memory.ctypes.data
    while atomic_load(memory, _QUIT) == 0:
        if wait_until(scratch, descriptor, POLLIN, now_ns(scratch) + _LOOK_NS) <= 0:
            continue
        memory[_MESSAGE] = 0
        memory[_SENDER_SIZE] = _ROOM
        received = receive_from(
            descriptor, address + 8 * _MESSAGE, 8, address + 8 * _SENDER, address + 8 * _SENDER_SIZE
        )
        if received <= 0 or (memory[_MESSAGE] != _STOP and memory[_MESSAGE] != _ESTOP):
            continue
        faults = memory[_MESSAGE] == _ESTOP
        if faults:
            authority.estop(words, now_ns(scratch))
        else:
            authority.stop(words, now_ns(scratch))
        size = memory[_SENDER_SIZE] & 0xFFFFFFFF
        if size <= 2:  # it has no address
            continue
        mode = _obeyed(words, scratch, faults)
        memory[_REPLY] = _STATES[mode] if mode >= 0 else _LATE
        length = 0
        while length < 8 and (memory[_REPLY] >> (8 * length)) & 0xFF != 0:
            length += 1
        send_to(descriptor, address + 8 * _REPLY, length, address + 8 * _SENDER, size)


@njit("void(int64[::1])", counted=False)
def _quit(memory: NDArray[Any]) -> None:
    atomic_store(memory, _QUIT, 1)


class StopChannel:
    """The listener's thread; it exists from the start.

    Args:
        words: of the authority.
        priority: of SCHED_FIFO, where it is granted.

    Raises:
        RuntimeError: a thread cannot be created.
    """

    def __init__(self, words: NDArray[np.int64], priority: int) -> None:
        self._words, self._priority = words, priority
        self._memory, self._scratch = np.zeros(_MEMORY, np.int64), np.zeros(SCRATCH, np.int64)
        self._has_socket = threading.Event()
        self._descriptor = -1
        self._thread = threading.Thread(target=self._run, name="hapticd-stop", daemon=True)
        self._thread.start()

    def listen(self, bound: socket.socket) -> None:
        """Begin to listen, or continue with another socket if the file of the previous one is gone.

        Args:
            bound: a bound datagram socket, owned by the caller.
        """
        if self._descriptor < 0:
            self._descriptor = os.dup(bound.fileno())
            self._has_socket.set()
        else:
            os.dup2(bound.fileno(), self._descriptor, inheritable=False)

    def alive(self) -> bool:
        """Whether the thread still runs."""
        return self._thread.is_alive()

    def end(self) -> None:
        """Stop listening. Safe to call twice and without `listen`."""
        _quit(self._memory)
        self._has_socket.set()
        self._thread.join(1.0)
        if self._descriptor >= 0 and not self._thread.is_alive():
            os.close(self._descriptor)
            self._descriptor = -1

    def _run(self) -> None:
        name_thread("hapticd-stop")
        block_signals()
        set_scheduler(self._priority)
        self._has_socket.wait()
        if self._descriptor >= 0:
            _listen(self._descriptor, self._words, self._memory, self._scratch)
