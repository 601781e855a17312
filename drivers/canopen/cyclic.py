"""The compiled cyclic exchange on a descriptor: SYNC (sent or awaited), TPDO 1, and later in the same tick RPDO 1.

One message on the descriptor is one 16-byte ``struct can_frame``: a SocketCAN raw socket, or a connection of
``drivers/seqpacket_bus.py``. The guarding message to the drive is sent after RPDO 1, where it delays nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from drivers.canopen import layout as w
from drivers.canopen._others import lose
from drivers.canopen._read_back import stops_node
from drivers.canopen._sync import sync_came
from drivers.canopen.supervision import (
    answered,
    asks_error_code,
    command,
    may_sync,
    sign_of_life,
    take_frame,
    verdict,
)
from drivers.interface import EXCHANGE_WORDS, LOST, MISSED, OK, X_DEADLINE_NS, X_PERIOD_NS, X_TIME_NS
from drivers.libc import POLLIN, now_ns, receive, send, wait_until
from hapticd.jit import carray, cfunc, njit

_SIGNATURE = types.int32(types.CPointer(types.int64), types.CPointer(types.int64))
_EAGAIN, _ENOBUFS, _EINTR = 11, 105, 4
_BURST = 64
"""Frames read at once: an overloaded bus must not block the loop."""
_BACKLOG = 1024
"""More than a socket's buffer: after a pause an old SYNC and its sample must not be taken for the present ones."""
_WORD_BYTES = 8


@njit("void(int64[::1], int64)", counted=False)
def _drain(s: NDArray[Any], burst: int) -> None:
    """Receive all frames that have arrived, without waiting."""
    for _ in range(burst):
        got = receive(s[w.DESCRIPTOR], s.ctypes.data + _WORD_BYTES * w.FRAME, w.FRAME_BYTES)
        if got == w.FRAME_BYTES:
            take_frame(s, s[w.FRAME], s[w.FRAME + 1])
        elif got == -_EAGAIN:
            return
        elif got == 0:
            lose(s, w.LOST_CLOSED, 0)
            return
        elif got > 0:
            s[w.IGNORED] += 1
        elif got != -_EINTR:
            lose(s, w.LOST_SOCKET, -got)
            return


@njit("int64(int64[::1])", counted=False)
def _send(s: NDArray[Any]) -> int:
    """Send the frame in OUT: OK, MISSED if the buffer is full, LOST."""
    sent = send(s[w.DESCRIPTOR], s.ctypes.data + _WORD_BYTES * w.OUT, w.FRAME_BYTES)
    if sent == w.FRAME_BYTES:
        return OK
    if sent == -_EAGAIN or sent == -_ENOBUFS or sent == -_EINTR:
        return MISSED
    lose(s, w.LOST_SOCKET, -sent)
    return LOST


@njit("void(int64[::1], int64)", counted=False)
def _listen(s: NDArray[Any], deadline: int) -> None:
    """Receive until a TPDO 1 has come, an event ends the tick, or the deadline."""
    scratch = s[w.SCRATCH :]
    while not answered(s):
        if wait_until(scratch, s[w.DESCRIPTOR], POLLIN, deadline) == 0:
            break
        _drain(s, _BURST)
        if now_ns(scratch) >= deadline:
            break


@njit("int64(int64[::1], int64[::1], float64)")
def wait(s: NDArray[Any], x: NDArray[Any], period_ns: float) -> int:
    """Wait for SYNC from the bus, until the exchange's deadline."""
    scratch = s[w.SCRATCH :]
    while s[w.REASON] == 0 and s[w.EVENT] == 0:
        _drain(s, _BACKLOG)
        now = now_ns(scratch)
        if sync_came(s, now, x[X_TIME_NS], period_ns):
            return OK
        if s[w.REASON] != 0 or s[w.EVENT] != 0:
            break
        if now >= x[X_DEADLINE_NS]:
            return MISSED
        wait_until(scratch, s[w.DESCRIPTOR], POLLIN, x[X_DEADLINE_NS])
    if s[w.REASON] != 0:
        # A lost device must not make the loop run without sleep.
        wait_until(scratch, -1, 0, now_ns(scratch) + int(period_ns))
    return OK  # read reports errors


@njit("int64(int64[::1], int64[::1], float64)")
def read(s: NDArray[Any], x: NDArray[Any], period_ns: float) -> int:
    """Send SYNC, receive TPDO 1; return codes: :func:`drivers.canopen.supervision.verdict`."""
    scratch = s[w.SCRATCH :]
    if s[w.REASON] == 0 and s[w.FOLLOWS] == 0:
        _drain(s, _BURST)
    deadline = now_ns(scratch) + (s[w.REPLY_NS] if s[w.REPLY_NS] > 0 else int(0.8 * period_ns))
    if s[w.FOLLOWS] == 1:
        s[w.STOPPED] = 0
        _listen(s, deadline)
        result = verdict(s, x, now_ns(scratch))
        if result == OK:
            s[w.SYNCS] = 0  # a SYNC received in this read belongs to this sample
        return result
    if not may_sync(s):
        _listen(s, deadline)
        if s[w.FRESH] == 0:
            return verdict(s, x, now_ns(scratch))
        may_sync(s)
    if s[w.REASON] == 0 and s[w.EVENT] == 0:
        s[w.OUT] = w.SYNC
        s[w.OUT + 1] = 0
        if _send(s) == OK:
            s[w.DUE] += 1
            _listen(s, deadline)
    return verdict(s, x, now_ns(scratch))


@njit("int64(int64[::1], int64[::1], float64)")
def write(s: NDArray[Any], x: NDArray[Any], period_ns: float) -> int:
    """Send RPDO 1, then other due frames to the drive."""
    now = now_ns(s[w.SCRATCH :])
    result = command(s, x, now)
    if s[w.REASON] == w.LOST_CLOSED or s[w.REASON] == w.LOST_SOCKET:
        return LOST
    sent = _send(s)
    if stops_node(s):
        _send(s)
    if sign_of_life(s, now, period_ns):
        _send(s)
    if asks_error_code(s):
        _send(s)
    if s[w.REASON] != 0:
        return LOST
    return result if result != OK else sent


@cfunc(_SIGNATURE)
def wait_function(state: int, exchange: int) -> int:
    """The driver's ``wait``."""
    x = carray(exchange, (EXCHANGE_WORDS,))
    return wait(carray(state, (w.WORDS,)), x, x.view(np.float64)[X_PERIOD_NS])


@cfunc(_SIGNATURE)
def read_function(state: int, exchange: int) -> int:
    """The driver's ``read``."""
    x = carray(exchange, (EXCHANGE_WORDS,))
    return read(carray(state, (w.WORDS,)), x, x.view(np.float64)[X_PERIOD_NS])


@cfunc(_SIGNATURE)
def write_function(state: int, exchange: int) -> int:
    """The driver's ``write``."""
    x = carray(exchange, (EXCHANGE_WORDS,))
    return write(carray(state, (w.WORDS,)), x, x.view(np.float64)[X_PERIOD_NS])
