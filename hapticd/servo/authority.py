"""Permission to move the motor, shared with the servo loop.

The ordinal of a command is the time at which it was sent, CLOCK_MONOTONIC in ns. A stop is one atomic store of the present
time: it revokes every command that was sent before, also one that is still unread in a socket's buffer. A command begins by
publishing its ordinal to the loop, and the tick renders while that ordinal is above the last revoked one. So no command that
waits in a buffer, a queue, a thread or the mailbox takes effect after a stop. In the same way a clear ends the faults that
existed when it was sent, and no later one, which its sender could not know.

States of a command:

| state | becomes | when |
|---|---|---|
| waiting | begun | its thread publishes it: not revoked, in time, its client still connected |
| waiting | revoked | a stop, an estop or a release of the enable that a person holds came after it was sent |
| waiting | expired | its deadline passed |
| waiting | gone | its client has closed the connection |
| waiting | answered | it was already answered (with an error) |
| begun | revoked | a stop or an estop came: zero current in the next tick; a clear: a fault was raised after it |

The words exist longer than any servo loop, so that a stop during the replacement of a rig also applies to the new one.
"""

from __future__ import annotations

import math
import threading
import time
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.jit import atomic_add, atomic_load, atomic_max, atomic_store, njit

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

# Words of the authority, each on its own cache line, except those of the loop.
REVOKED: Final = 0
"""Every ordinal up to this one is revoked: time of the last stop or of the last release of the enable input."""
ESTOPS: Final = 8
"""Number of requested software stops."""
LOOP_TICKS: Final = 16
"""Ticks of all real-time loops, over all rigs; written by the loop."""
LOOP_MODE: Final = 17
"""Mode after the last tick; written by the loop."""
FAULTED: Final = 18
"""Time of the newest fault: a clear must be sent later; written by the loop."""
SIZE: Final = 24

FIRST: Final = 1
"""Ordinal for a loop without authority: a simulation, a test."""
FOREVER: Final = 2**62
"""Above every ordinal: no command can begin."""


@njit("void(int64[::1], int64)", counted=False)
def stop(words: NDArray[Any], now_ns: int) -> None:
    """Revoke every command that was sent before now: zero current in the next tick. From any thread, without the GIL."""
    atomic_max(words, REVOKED, now_ns)


@njit("void(int64[::1], int64)", counted=False)
def estop(words: NDArray[Any], now_ns: int) -> None:
    """The same, and a latched fault."""
    atomic_max(words, REVOKED, now_ns)
    atomic_add(words, ESTOPS, 1)


@njit("void(int64[::1])", counted=False)
def _end(words: NDArray[Any]) -> None:
    atomic_store(words, REVOKED, FOREVER)


@njit("void(int64[::1], int64)", counted=False)
def faulted(words: NDArray[Any], now_ns: int) -> None:
    """A fault was raised now: a clear that was sent before does not clear it."""
    atomic_max(words, FAULTED, now_ns)


@njit("int64(int64[::1], int64)", counted=False)
def _load(words: NDArray[Any], index: int) -> int:
    return int(atomic_load(words, index))


def new_words() -> NDArray[np.int64]:
    """Words of a new authority: nothing is revoked."""
    return np.zeros(SIZE, np.int64)


class Withdrawn(Exception):  # noqa: N818 - an answer, not an error of the program
    """A command can no longer begin.

    Attributes:
        code: ``stopped``, ``expired``, ``gone`` or ``answered``.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class Command:
    """One command that requests motion or clears a fault.

    Args:
        authority: that may revoke it.
        ordinal: when it was sent, `time.monotonic_ns`.
        deadline_s: `time.monotonic` after which it may not begin.
        is_there: whether its client still waits for the reply.
    """

    def __init__(self, authority: Authority, ordinal: int, deadline_s: float, is_there: Callable[[], bool]) -> None:
        self.ordinal = ordinal
        self._authority, self._deadline_s, self._is_there = authority, deadline_s, is_there
        self._lock = threading.Lock()
        self._answered = self._begun = False

    def begin(self, publish: Callable[[int], None]) -> None:
        """Publish the ordinal to the loop, unless the command is withdrawn; the tick checks again whether it is revoked.

        Args:
            publish: publishes a parameter set with this ordinal.

        Raises:
            Withdrawn: it can no longer begin.
        """
        with self._lock:
            self.refuse()
            self._begun = True
            publish(self.ordinal)

    def refuse(self) -> None:
        """Raise if the command can no longer begin.

        Raises:
            Withdrawn: with the reason.
        """
        if self.is_revoked():
            raise Withdrawn("stopped", "stopped before it began")
        if self._answered:
            raise Withdrawn("answered", "answered before it began")
        late_s = time.monotonic() - self._deadline_s
        if not self._begun and late_s > 0.0:
            raise Withdrawn("expired", f"not begun: its turn came {late_s:.1f} s after its deadline; send it again")
        if not self._is_there():
            raise Withdrawn("gone", "its client has closed the connection")

    def further(self, is_there: Callable[[], bool]) -> Command:
        """A command for later steps of this one, after its reply: revoked with it, and without a deadline.

        Args:
            is_there: whether it is still needed.
        """
        return Command(self._authority, self.ordinal, math.inf, is_there)

    def answered(self) -> None:
        """The command was answered: it can no longer begin."""
        with self._lock:
            self._answered = not self._begun

    def is_revoked(self) -> bool:
        """Whether a stop came after it was sent."""
        return self._authority.revoked >= self.ordinal


class Authority:
    """Decides for every command whether it may still move the motor.

    Attributes:
        words: memory shared with the tick and the stop channel (`REVOKED` and the others).
    """

    def __init__(self) -> None:
        self.words = new_words()

    @property
    def revoked(self) -> int:
        """Last revoked ordinal."""
        return int(_load(self.words, REVOKED))

    def arrived(
        self,
        limit_s: float,
        is_there: Callable[[], bool] = lambda: True,
        not_after_s: float = math.inf,
        sent_ns: int | None = None,
    ) -> Command:
        """The command of an arrived request for motion or for a clear.

        Args:
            limit_s: time within which it must begin, s.
            is_there: whether its client still waits.
            not_after_s: `time.monotonic` at which its client stops waiting.
            sent_ns: earliest `time.monotonic_ns` at which it was sent; None: now. A time in the future counts as
                now.
        """
        now_ns = time.monotonic_ns()
        ordinal = now_ns if sent_ns is None else min(sent_ns, now_ns)
        return Command(self, ordinal, min(now_ns * 1e-9 + limit_s, not_after_s), is_there)

    def stop(self) -> None:
        """Revoke every command that was sent before. Needs no lock, thread or descriptor; cannot fail."""
        stop(self.words, time.monotonic_ns())

    def estop(self) -> None:
        """The same, and a latched fault."""
        estop(self.words, time.monotonic_ns())

    def faulted(self) -> None:
        """A fault was raised while no loop runs: a clear that was sent before does not clear it."""
        faulted(self.words, time.monotonic_ns())

    def end(self) -> None:
        """Revoke every command for ever."""
        _end(self.words)

    def load(self, index: int) -> int:
        """One of the words."""
        return int(_load(self.words, index))
