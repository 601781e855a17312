"""The compiled cyclic service on descriptors: wait, receive, reply.

The descriptors are for ``struct can_frame``: clients of a listening AF_UNIX SOCK_SEQPACKET socket, for which this process
is the bus and also forwards every frame to the other clients; or one raw SocketCAN socket, for which the kernel is the bus.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numpy.typing import NDArray

from hapticd.jit import njit
from sim_hw import layout as common
from sim_hw._clock import POLLERR, POLLHUP, POLLIN, monotonic_ns, pollfd, returned_events, wait_readable
from sim_hw.canopen import layout as w
from sim_hw.canopen._receiving import let_go, receive
from sim_hw.canopen._sending import FRAME_BYTES
from sim_hw.canopen._timeline import next_wake
from sim_hw.canopen.layout import MACHINE, Machine
from sim_hw.layout import I64, INTS

CLIENTS = 4
"""Most clients of a bus; further ones are refused."""
LISTENER = CLIENTS
DESCRIPTOR_WORDS = 16
"""int64 words of the service's descriptors: CLIENTS clients and the listener (−1: none), then scratch."""
_POLL = 8
_FRAME = 14

_SOCK_NONBLOCK, _SOCK_CLOEXEC = 0o4000, 0o2000000
_MSG_DONTWAIT, _MSG_NOSIGNAL = 0x40, 0x4000
_recv = types.ExternalFunction("recv", types.intp(types.intc, types.intp, types.uintp, types.intc))
_send = types.ExternalFunction("send", types.intp(types.intc, types.intp, types.uintp, types.intc))
_close = types.ExternalFunction("close", types.intc(types.intc))
_accept = types.ExternalFunction("accept4", types.intc(types.intc, types.intp, types.intp, types.intc))


@njit((INTS, I64), counted=False)
def hang_up(fds: NDArray[Any], client: int) -> None:
    """Close one client's descriptor, if there is one."""
    if fds[client] >= 0:
        _close(fds[client])
        fds[client] = -1


@njit((INTS,), counted=False)
def _welcome(fds: NDArray[Any]) -> None:
    descriptor = _accept(fds[LISTENER], 0, 0, _SOCK_NONBLOCK | _SOCK_CLOEXEC)
    for client in range(CLIENTS):
        if descriptor >= 0 and fds[client] < 0:
            fds[client] = descriptor
            return
    if descriptor >= 0:
        _close(descriptor)


@njit((INTS, I64, I64), counted=False)
def _to_all_but(fds: NDArray[Any], sender: int, word: int) -> None:
    """Send the frame at ``fds[word]`` to all clients but the sender; a client that does not read loses it."""
    for client in range(CLIENTS):
        if client != sender and fds[client] >= 0:
            _send(fds[client], fds[word:].ctypes.data, FRAME_BYTES, _MSG_DONTWAIT | _MSG_NOSIGNAL)


@njit((MACHINE, INTS), counted=False)
def flush(m: Machine, fds: NDArray[Any]) -> None:
    """Send every queued frame to all clients."""
    for row in range(m.d[w.OUT_COUNT]):
        fds[_FRAME], fds[_FRAME + 1] = m.out[row, 0], m.out[row, 1]
        _to_all_but(fds, -1, _FRAME)
    m.d[w.OUT_COUNT] = 0


@njit((MACHINE, INTS, I64, INTS), counted=False)
def _read_client(m: Machine, fds: NDArray[Any], client: int, timespec: NDArray[Any]) -> None:
    """Receive every frame that a client has sent, at the instant of its reading."""
    while fds[client] >= 0:
        size = _recv(fds[client], fds[_FRAME:].ctypes.data, FRAME_BYTES, _MSG_DONTWAIT)
        if size == 0:
            hang_up(fds, client)
        if size != FRAME_BYTES:
            return
        now = monotonic_ns(timespec)
        if fds[LISTENER] >= 0:
            _to_all_but(fds, client, _FRAME)
        receive(m, fds[_FRAME], fds[_FRAME + 1], now)
        flush(m, fds)
        if m.d[w.SDO_COUNT] or m.d[w.RESET]:
            return


@njit((MACHINE, INTS, INTS, I64), counted=False)
def serve(m: Machine, fds: NDArray[Any], timespec: NDArray[Any], until: int) -> None:
    """Serve until an instant, or until there is work for Python: SDO requests, a reset, an unplugged cable, the end.

    Args:
        m: the drive. fds: (DESCRIPTOR_WORDS,) descriptors. timespec: (2,) scratch. until: ns.
    """
    flush(m, fds)
    while m.sim.s[common.STOP] == 0:
        count = 0
        for slot in range(CLIENTS + 1):
            if fds[slot] >= 0:
                fds[_POLL + count] = pollfd(fds[slot], POLLIN)
                count += 1
        now = monotonic_ns(timespec)
        wait_readable(fds[_POLL:], count, timespec, min(next_wake(m), until) - now)
        position = 0
        for slot in range(CLIENTS + 1):
            if fds[slot] < 0:
                continue
            events = returned_events(fds[_POLL + position])
            position += 1
            if slot == LISTENER and events:
                _welcome(fds)
            elif events & (POLLIN | POLLHUP | POLLERR):
                _read_client(m, fds, slot, timespec)
        now = monotonic_ns(timespec)
        let_go(m, now)
        flush(m, fds)
        unplugged = now < m.d[w.UNPLUGGED_UNTIL_NS] and (fds[LISTENER] >= 0 or fds[0] >= 0)
        if now >= until or m.d[w.SDO_COUNT] or m.d[w.RESET] or unplugged:
            return
