"""Who may set the motor in motion: the one authority, shared with the tick.

The ordinal of a command is the time at which it was sent, CLOCK_MONOTONIC in ns. A stop is one atomic store of the time at
hand: it revokes every command that was sent before, whether it has been read or still lies in a socket's buffer because
nobody could read it. A command begins by publishing its ordinal to the loop, and the tick renders for as long as that
ordinal is above the last revoked one, so that nothing that waits in a buffer, a queue, a thread or the mailbox can outlive a
stop. In the same way a clear ends the faults that were there when it was sent, and no later one: nobody has seen that yet.

A command, its states and what moves it on:

| state | becomes | when |
|---|---|---|
| waiting | begun | its thread publishes it: not revoked, in time, its client still there |
| waiting | revoked | a stop, an estop or a release of the enable that a person holds came after it was sent |
| waiting | expired | its deadline passed |
| waiting | gone | its client hung up |
| waiting | answered | it was answered already (with an error) |
| begun | revoked | a stop or an estop came: zero current in the next tick; a clear: a fault was raised after it |

The words outlive any servo loop, so that a stop that comes while a rig is replaced counts for the new one as well.
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

# Words of the authority, each on a cache line of its own but for those of the loop.
REVOKED: Final = 0
"""Every ordinal up to this one is revoked: when the last stop came, or a person let go of the enable."""
ESTOPS: Final = 8
"""How many software stops were asked for."""
LOOP_TICKS: Final = 16
"""Ticks that real-time loops have done, over all rigs; written by the loop."""
LOOP_MODE: Final = 17
"""Mode after the last tick; written by the loop."""
FAULTED: Final = 18
"""When the newest fault was raised: a clear counts if it was sent later; written by the loop."""
SIZE: Final = 24

FIRST: Final = 1
"""Ordinal of whoever asks nobody: a simulation, a test of the loop."""
FOREVER: Final = 2**62
"""Above every ordinal: nothing begins any more."""


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
def _faulted(words: NDArray[Any], now_ns: int) -> None:
    atomic_max(words, FAULTED, now_ns)


@njit("int64(int64[::1], int64)", counted=False)
def _load(words: NDArray[Any], index: int) -> int:
    return int(atomic_load(words, index))


def new_words() -> NDArray[np.int64]:
    """Words of an authority under which nothing is revoked."""
    return np.zeros(SIZE, np.int64)


class Withdrawn(Exception):  # noqa: N818 - an answer, not an error of the program
    """A command may not begin any more.

    Attributes:
        code: ``stopped``, ``expired``, ``gone`` or ``answered``.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class Command:
    """One command that asks for motion, or clears a fault, from its arrival on.

    Args:
        authority: that may revoke it.
        ordinal: when it was sent, `time.monotonic_ns`.
        deadline_s: `time.monotonic` after which it may not begin.
        is_there: whether its client still waits for the answer.
    """

    def __init__(self, authority: Authority, ordinal: int, deadline_s: float, is_there: Callable[[], bool]) -> None:
        self.ordinal = ordinal
        self._authority, self._deadline_s, self._is_there = authority, deadline_s, is_there
        self._lock = threading.Lock()
        self._answered = self._begun = False

    def begin(self, publish: Callable[[int], None]) -> None:
        """Hand the ordinal to the loop, unless the command is withdrawn; the tick asks once more whether it is revoked.

        Args:
            publish: gives the loop a parameter set with this ordinal.

        Raises:
            Withdrawn: it may not begin any more.
        """
        with self._lock:
            self.refuse()
            self._begun = True
            publish(self.ordinal)

    def refuse(self) -> None:
        """Refuse to go on where it could not begin any more.

        Raises:
            Withdrawn: with the reason.
        """
        if self.is_revoked():
            raise Withdrawn("stopped", "stopped before it began")
        if self._answered:
            raise Withdrawn("answered", "it had been answered before it began")
        late_s = time.monotonic() - self._deadline_s
        if not self._begun and late_s > 0.0:
            raise Withdrawn("expired", f"it was not begun: its turn came {late_s:.1f} s after its deadline; ask again")
        if not self._is_there():
            raise Withdrawn("gone", "who asked for it has gone")

    def further(self, is_there: Callable[[], bool]) -> Command:
        """For what follows from this one when it has long been answered: it is revoked with it, and has no deadline.

        Args:
            is_there: whether it is still wanted.
        """
        return Command(self._authority, self.ordinal, math.inf, is_there)

    def answered(self) -> None:
        """It has been answered: if it has not begun by now, it never will."""
        with self._lock:
            self._answered = not self._begun

    def is_revoked(self) -> bool:
        """Whether a stop has come since it was sent."""
        return self._authority.revoked >= self.ordinal


class Authority:
    """Says of every command whether it may still set the motor in motion.

    Attributes:
        words: what the tick and the stop channel share with it (`ORDINAL` and those after it).
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
        """A command that asks for motion, or clears a fault, has arrived.

        Args:
            limit_s: time within which it has to begin, s.
            is_there: whether its client still waits.
            not_after_s: `time.monotonic` at which its client gives up.
            sent_ns: `time.monotonic_ns` before which it was not sent; None: now. What is said to be sent later than now is
                sent now.
        """
        now_ns = time.monotonic_ns()
        ordinal = now_ns if sent_ns is None else min(sent_ns, now_ns)
        return Command(self, ordinal, min(now_ns * 1e-9 + limit_s, not_after_s), is_there)

    def stop(self) -> None:
        """Revoke every command that was sent before. Takes no lock, no thread, no descriptor; cannot fail."""
        stop(self.words, time.monotonic_ns())

    def estop(self) -> None:
        """The same, and a latched fault."""
        estop(self.words, time.monotonic_ns())

    def faulted(self) -> None:
        """A fault is raised where no loop runs that could say so: no clear that was sent before counts for it."""
        _faulted(self.words, time.monotonic_ns())

    def end(self) -> None:
        """Revoke every command for ever."""
        _end(self.words)

    def load(self, index: int) -> int:
        """One of the words."""
        return int(_load(self.words, index))
