"""C library functions for a compiled exchange: clock, waiting for a descriptor, datagrams and bytes.

The caller gives scratch memory, so that nothing is allocated: ``scratch`` is an int64 array of at least SCRATCH words. All
results are ``>= 0``, or ``-errno``. Linux, little-endian (``struct pollfd`` is built in one word).
"""

from __future__ import annotations

from typing import Any, Final

from numba import types
from numpy.typing import NDArray

from hapticd.jit import carray, njit

SCRATCH: Final = 3
"""Words of scratch: a ``struct timespec`` and a ``struct pollfd``."""
POLLIN: Final = 0x1

_CLOCK_MONOTONIC = 1
_MSG_DONTWAIT_NOSIGNAL = 0x40 | 0x4000
_EINTR = 4
_SECOND = 1_000_000_000
_POLLFD = 2

_clock_gettime = types.ExternalFunction("clock_gettime", types.intc(types.intc, types.intp))
_ppoll = types.ExternalFunction("ppoll", types.intc(types.intp, types.uintp, types.intp, types.intp))
_send = types.ExternalFunction("send", types.intp(types.intc, types.intp, types.uintp, types.intc))
_recv = types.ExternalFunction("recv", types.intp(types.intc, types.intp, types.uintp, types.intc))
_recvfrom = types.ExternalFunction(
    "recvfrom", types.intp(types.intc, types.intp, types.uintp, types.intc, types.intp, types.intp)
)
_sendto = types.ExternalFunction(
    "sendto", types.intp(types.intc, types.intp, types.uintp, types.intc, types.intp, types.uint32)
)
_read = types.ExternalFunction("read", types.intp(types.intc, types.intp, types.uintp))
_write = types.ExternalFunction("write", types.intp(types.intc, types.intp, types.uintp))
_errno_location = types.ExternalFunction("__errno_location", types.CPointer(types.int32)())


@njit(types.int64(types.CPointer(types.int32)))
def _word_at(pointer: Any) -> int:
    return int(carray(pointer, (1,))[0])


@njit("int64()")
def errno() -> int:
    """This thread's ``errno``."""
    return _word_at(_errno_location())


@njit("int64(int64[::1])", counted=False)
def now_ns(scratch: NDArray[Any]) -> int:
    """CLOCK_MONOTONIC in ns."""
    _clock_gettime(_CLOCK_MONOTONIC, scratch.ctypes.data)
    return int(scratch[0] * _SECOND + scratch[1])


@njit("int64(int64[::1], int64, int64, int64)", counted=False)
def wait_until(scratch: NDArray[Any], descriptor: int, events: int, deadline_ns: int) -> int:
    """Wait for ``events`` on a descriptor until an instant of CLOCK_MONOTONIC; with a past instant it only checks.

    Returns:
        ``revents`` (also POLLERR, POLLHUP and POLLNVAL), 0 after the deadline, or ``-errno``.
    """
    while True:
        left = max(deadline_ns - now_ns(scratch), 0)
        scratch[0], scratch[1] = left // _SECOND, left % _SECOND
        scratch[_POLLFD] = descriptor | (events << 32)
        address = scratch.ctypes.data
        ready = _ppoll(address + 8 * _POLLFD, 1, address, 0)
        if ready > 0:
            return int((scratch[_POLLFD] >> 48) & 0xFFFF)
        if ready == 0:
            return 0
        error = errno()
        if error != _EINTR:
            return -error


@njit("int64(int64, int64, int64)", counted=False)
def send(descriptor: int, address: int, size: int) -> int:
    """Send ``size`` bytes on a socket without waiting and without SIGPIPE: bytes sent, or ``-errno``."""
    sent = _send(descriptor, address, size, _MSG_DONTWAIT_NOSIGNAL)
    return int(sent) if sent >= 0 else -errno()


@njit("int64(int64, int64, int64)", counted=False)
def receive(descriptor: int, address: int, size: int) -> int:
    """Receive at most ``size`` bytes from a socket without waiting: bytes, 0 at its end, or ``-errno``."""
    received = _recv(descriptor, address, size, _MSG_DONTWAIT_NOSIGNAL)
    return int(received) if received >= 0 else -errno()


@njit("int64(int64, int64, int64, int64, int64)", counted=False)
def receive_from(descriptor: int, address: int, size: int, sender: int, sender_size: int) -> int:
    """Receive a datagram without waiting: its bytes, or ``-errno``.

    Args:
        descriptor: of the socket. address, size: buffer for the datagram.
        sender: address of a ``struct sockaddr``. sender_size: address of its ``socklen_t``, set by caller and kernel.
    """
    received = _recvfrom(descriptor, address, size, _MSG_DONTWAIT_NOSIGNAL, sender, sender_size)
    return int(received) if received >= 0 else -errno()


@njit("int64(int64, int64, int64, int64, int64)", counted=False)
def send_to(descriptor: int, address: int, size: int, receiver: int, receiver_size: int) -> int:
    """Send a datagram to a ``struct sockaddr`` of ``receiver_size`` bytes without waiting: bytes sent, or ``-errno``."""
    sent = _sendto(descriptor, address, size, _MSG_DONTWAIT_NOSIGNAL, receiver, receiver_size)
    return int(sent) if sent >= 0 else -errno()


@njit("int64(int64, int64, int64)", counted=False)
def read(descriptor: int, address: int, size: int) -> int:
    """Read at most ``size`` bytes: bytes, 0 at the end of the file, or ``-errno`` (a non-blocking one: -EAGAIN)."""
    got = _read(descriptor, address, size)
    return int(got) if got >= 0 else -errno()


@njit("int64(int64, int64, int64)", counted=False)
def write(descriptor: int, address: int, size: int) -> int:
    """Write ``size`` bytes: bytes written, which may be fewer, or ``-errno``."""
    put = _write(descriptor, address, size)
    return int(put) if put >= 0 else -errno()
