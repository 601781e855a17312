"""Who may set the motor in motion: the one authority, shared with the tick.

Every command that asks for motion, or clears a fault, gets an ordinal when it arrives. A stop is one atomic store: it
revokes every ordinal that was given before. A command begins by publishing its ordinal to the loop, and the tick renders for
as long as that ordinal is above the last revoked one, so that nothing that waits in a queue, a thread or the mailbox can
outlive a stop. In the same way a clear ends the faults that were there when it arrived, and no later one: nobody has seen
that yet.

A command, its states and what moves it on:

| state | becomes | when |
|---|---|---|
| waiting | begun | its thread publishes it: not revoked, in time, its client still there |
| waiting | revoked | a stop or an estop arrived after it |
| waiting | expired | its deadline passed |
| waiting | gone | its client hung up |
| waiting | answered | it was answered already (with an error) |
| begun | revoked | a stop or an estop arrived: zero current in the next tick; a clear: a fault was raised after it |

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
ORDINAL: Final = 0
"""The last ordinal that was given."""
REVOKED: Final = 8
"""Every ordinal up to this one is revoked."""
ESTOPS: Final = 16
"""How many software stops were asked for."""
LOOP_TICKS: Final = 24
"""Ticks that real-time loops have done, over all rigs; written by the loop."""
LOOP_MODE: Final = 25
"""Mode after the last tick; written by the loop."""
FAULTED: Final = 26
"""The last ordinal that had been given when the newest fault was raised: a clear counts if it arrived later; by the loop."""
SIZE: Final = 32

FIRST: Final = 1
"""Ordinal of whoever asks nobody: a simulation, a test of the loop."""
FOREVER: Final = 2**62
"""Above every ordinal: nothing begins any more."""


@njit("int64(int64[::1])", counted=False)
def _next(words: NDArray[Any]) -> int:
    return int(atomic_add(words, ORDINAL, 1)) + 1


@njit("void(int64[::1])", counted=False)
def stop(words: NDArray[Any]) -> None:
    """Revoke every command that has arrived: zero current in the next tick. From any thread, without the GIL."""
    atomic_max(words, REVOKED, atomic_load(words, ORDINAL))


@njit("void(int64[::1])", counted=False)
def estop(words: NDArray[Any]) -> None:
    """The same, and a latched fault."""
    atomic_max(words, REVOKED, atomic_load(words, ORDINAL))
    atomic_add(words, ESTOPS, 1)


@njit("void(int64[::1])", counted=False)
def _end(words: NDArray[Any]) -> None:
    atomic_store(words, REVOKED, FOREVER)


@njit("void(int64[::1])", counted=False)
def _faulted(words: NDArray[Any]) -> None:
    atomic_store(words, FAULTED, atomic_load(words, ORDINAL))


@njit("int64(int64[::1], int64)", counted=False)
def _load(words: NDArray[Any], index: int) -> int:
    return int(atomic_load(words, index))


def new_words() -> NDArray[np.int64]:
    """Words of an authority of nobody's: the first ordinal is given, none is revoked."""
    words = np.zeros(SIZE, np.int64)
    words[ORDINAL] = FIRST
    return words


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
        authority: that gave the ordinal.
        ordinal: its own.
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

    def answered(self) -> None:
        """It has been answered: if it has not begun by now, it never will."""
        with self._lock:
            self._answered = not self._begun

    def is_revoked(self) -> bool:
        """Whether a stop has come since it arrived."""
        return self._authority.revoked >= self.ordinal


class Authority:
    """Gives ordinals, and takes them back.

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
        self, limit_s: float, is_there: Callable[[], bool] = lambda: True, not_after_s: float = math.inf
    ) -> Command:
        """A command that asks for motion, or clears a fault, has arrived.

        Args:
            limit_s: time within which it has to begin, s.
            is_there: whether its client still waits.
            not_after_s: `time.monotonic` at which its client gives up.
        """
        return Command(self, int(_next(self.words)), min(time.monotonic() + limit_s, not_after_s), is_there)

    def stop(self) -> None:
        """Revoke every command that has arrived. Takes no lock, no thread, no descriptor; cannot fail."""
        stop(self.words)

    def estop(self) -> None:
        """The same, and a latched fault."""
        estop(self.words)

    def faulted(self) -> None:
        """A fault is raised where no loop runs that could say so: no clear that has arrived counts for it."""
        _faulted(self.words)

    def end(self) -> None:
        """Revoke every command for ever."""
        _end(self.words)

    def load(self, index: int) -> int:
        """One of the words."""
        return int(_load(self.words, index))
