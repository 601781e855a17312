"""The cyclic exchange through python-can, for interfaces without a descriptor of CAN frames (udp_multicast, slcan, …).

The same supervision as in the compiled path, called from Python: late when the GIL is busy, so for low rates.
"""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING

import can
import numpy as np

from drivers.canopen import layout as w
from drivers.canopen._others import lose
from drivers.canopen._read_back import stops_node
from drivers.canopen.supervision import (
    answered,
    asks_error_code,
    command,
    may_sync,
    sign_of_life,
    take_frame,
    verdict,
)
from drivers.interface import LOST, OK, X_PERIOD_NS
from drivers.seqpacket_bus import pack, unpack

if TYPE_CHECKING:
    from numpy.typing import NDArray

_BURST = 64
_REMEMBERED = 16


class CallbackExchange:
    """Read and write of one drive over a python-can bus.

    Args:
        bus: not read by others. block: the exchange's memory. echoes: whether the interface returns own frames.
    """

    def __init__(self, bus: can.BusABC, block: NDArray[np.int64], *, echoes: bool) -> None:
        self._bus = bus
        self._block = block
        self._sent: deque[bytes] | None = deque(maxlen=_REMEMBERED) if echoes else None

    def read(self, x: NDArray[np.int64]) -> int:
        """Send SYNC, receive TPDO 1."""
        s = self._block
        for _ in range(_BURST):
            if s[w.REASON] != 0 or not self._receive(0.0):
                break
        deadline = time.monotonic_ns() + (int(s[w.REPLY_NS]) or int(0.8 * x.view(np.float64)[X_PERIOD_NS]))
        if not may_sync(s):
            self._listen(deadline)
            if s[w.FRESH] == 0:
                return int(verdict(s, x, time.monotonic_ns()))
            may_sync(s)
        if s[w.REASON] == 0 and s[w.EVENT] == 0:
            s[w.OUT], s[w.OUT + 1] = w.SYNC, 0
            self._send()
            s[w.DUE] += 1
            self._listen(deadline)
        return int(verdict(s, x, time.monotonic_ns()))

    def _listen(self, deadline: int) -> None:
        """Receive until a TPDO 1 has come, an event ends the tick, or the deadline."""
        while not answered(self._block):
            left = deadline - time.monotonic_ns()
            if left <= 0:
                break
            self._receive(1e-9 * left)

    def write(self, x: NDArray[np.int64]) -> int:
        """Send RPDO 1, then other due frames to the drive."""
        s, now = self._block, time.monotonic_ns()
        result = int(command(s, x, now))
        if s[w.REASON] in (w.LOST_CLOSED, w.LOST_SOCKET):
            return LOST
        self._send()
        if stops_node(s):
            self._send()
        if sign_of_life(s, now, float(x.view(np.float64)[X_PERIOD_NS])):
            self._send()
        if asks_error_code(s):
            self._send()
        return LOST if s[w.REASON] != 0 else result if result != OK else OK

    def _receive(self, timeout_s: float) -> bool:
        """Receive one frame; False if there is none."""
        try:
            message = self._bus.recv(timeout_s)
        except (can.CanError, OSError) as error:
            lose(self._block, w.LOST_SOCKET, getattr(error, "error_code", None) or getattr(error, "errno", None) or 0)
            return False
        if message is None:
            return False
        if message.is_fd or len(message.data) > 8:
            self._block[w.IGNORED] += 1
            return True
        frame = pack(message)
        if self._sent is not None and frame in self._sent:
            self._sent.remove(frame)
            return True
        low, data = np.frombuffer(frame, np.int64)
        take_frame(self._block, low, data)
        return True

    def _send(self) -> None:
        frame = self._block[w.OUT : w.OUT + 2].tobytes()
        try:
            self._bus.send(unpack(frame))
        except (can.CanError, OSError) as error:
            lose(self._block, w.LOST_SOCKET, getattr(error, "error_code", None) or getattr(error, "errno", None) or 0)
            return
        if self._sent is not None:
            self._sent.append(frame)
