"""A stop or an estop from its arrival to its answer, without any lock, thread, descriptor or log line.

Creating a `Halt` is the stop itself: one store that the tick reads. The API calls `poll` in its event loop until it has an
answer; a caller in this process uses `wait`.
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
"""The loop reacts within two ticks; after this time it does not answer [s]."""
_REPLACED_S: Final = 10.0
"""Longest start of a new rig, which reacts in its first tick [s]."""
_TIDY_S: Final = 2.0
"""Longest wait of the answer for the end of the recording, after the current is zero [s]."""
_TICKS: Final = 2
_LONGEST_LOOK_S: Final = 0.1
"""Time between two polls counts as waiting up to this: a frozen process did not see whether the loop reacts [s]."""


class Halt:
    """One stop.

    Args:
        rendering: the present rig, which a reload may be replacing, and the authority.
        latches: whether it is an estop, which latches a fault and waits for nothing else.
        is_tidy: returns whether recording and experiment have ended.
        status: returns the answer.
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
        """The answer; None: not yet.

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
        """Wait for the answer, in the caller's thread.

        Raises:
            DriverFailure: the loop does not answer.
        """
        while (answer := self.poll()) is None:
            time.sleep(POLL_S)
        return answer

    def _watch(self, rig: Rig) -> None:
        """Count ticks from now: the present tick may have begun before the stop."""
        self._watched, self._ticks, self._waited_s = rig, rig.core.load(atomics.TICKS), 0.0

    def _obeys(self) -> bool:
        rig = self._rendering.rig
        if rig.closed:
            return not self._latches  # it ended with zero current; an estop must also reach the next rig
        if rig is not self._watched:
            self._watch(rig)
        if rig.core.load(atomics.TICKS) < self._ticks + _TICKS:
            return False
        # Since then a later command may have started a motion, or cleared the fault.
        if self._latches:
            return rig.core.estops_obeyed >= self._estops
        return rig.state in (layout.OFF, layout.FAULT) or rig.core.ordinal > self._revoked
