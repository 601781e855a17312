"""A stop or an estop from its arrival to its answer: no lock, no thread, no descriptor, no line in the log.

Making a `Halt` is the stop itself: one store that the tick reads. `poll` is asked by whoever answers: the API in its event
loop, a caller in this process in a loop of its own.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from hapticd.service.refusals import DriverFailure
from hapticd.servo import atomics, layout
from hapticd.servo.authority import ESTOPS

if TYPE_CHECKING:
    from collections.abc import Callable

    from hapticd.control.endpoints import JsonDict
    from hapticd.service.rendering import Rendering
    from hapticd.service.rig import Rig

POLL_S: Final = 0.002
_OBEYED_S: Final = 1.0
"""The loop obeys within two ticks; longer than this, and it does not."""
_REPLACED_S: Final = 10.0
"""How long another rig may take to come up: it obeys in its first tick."""
_TIDY_S: Final = 2.0
"""How long the answer may wait for the end of the recording, once the current is zero."""
_TICKS: Final = 2
_LONGEST_LOOK_S: Final = 0.1
"""What lies between two looks counts as waiting up to this: who was frozen has not seen whether the loop obeys."""


class Halt:
    """One stop.

    Args:
        rendering: the rig in force, which a reload may be about to replace, and the authority.
        latches: whether it is an estop: a fault is latched, and nothing is waited for but that.
        is_tidy: whether recording and experiment have ended.
        status: the answer.
    """

    def __init__(
        self, rendering: Rendering, *, latches: bool, is_tidy: Callable[[], bool], status: Callable[[], JsonDict]
    ) -> None:
        authority = rendering.authority
        (authority.estop if latches else authority.stop)()
        self._revoked, self._estops = authority.revoked, authority.load(ESTOPS)
        self._rendering, self._latches, self._is_tidy, self._status = rendering, latches, is_tidy, status
        self._obeyed_s: float | None = None
        self._polled_s = time.monotonic()
        self._watch(rendering.rig)

    def poll(self) -> JsonDict | None:
        """The answer; None: ask again.

        Raises:
            DriverFailure: the loop does not answer.
        """
        now = time.monotonic()
        self._waited_s += min(now - self._polled_s, _LONGEST_LOOK_S)
        self._polled_s = now
        if self._obeyed_s is None:
            if self._obeys():
                self._obeyed_s = now
            elif self._waited_s > (_REPLACED_S if self._rendering.rig.closed else _OBEYED_S):
                raise DriverFailure("the servo loop does not answer; cut the power of the amplifier")
            else:
                return None
        if self._latches or self._is_tidy() or now - self._obeyed_s > _TIDY_S:
            return self._status()
        return None

    def wait(self) -> JsonDict:
        """The answer, for a caller that has a thread to wait in.

        Raises:
            DriverFailure: the loop does not answer.
        """
        while (answer := self.poll()) is None:
            time.sleep(POLL_S)
        return answer

    def _watch(self, rig: Rig) -> None:
        """Count from here: the tick at hand may have begun before the stop."""
        self._watched, self._ticks, self._waited_s = rig, rig.core.load(atomics.TICKS), 0.0

    def _obeys(self) -> bool:
        rig = self._rendering.rig
        if rig.closed:
            return not self._latches  # it ended by way of zero current, and the next one has to be told first
        if rig is not self._watched:
            self._watch(rig)
        if rig.core.load(atomics.TICKS) < self._ticks + _TICKS:
            return False
        # A command that arrived later may have begun, and a clear that did may have come, since the loop obeyed.
        if self._latches:
            return rig.core.estops_obeyed >= self._estops
        return rig.state in (layout.OFF, layout.FAULT) or rig.core.ordinal > self._revoked
