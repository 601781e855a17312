"""Whether the drive follows its commands, compiled: comparison of TPDO 2 with the latest commands and the mode.

A drive that receives SYNC and guarding, but no RPDO, keeps its last current without any other sign. While the commands do
not change, that current is right; when they change, the demand shows the difference.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.canopen import layout as w
from drivers.canopen.state_machine import ENABLED, state_of
from drivers.interface import LOST, MISSED, OK
from hapticd.jit import njit

_LIMIT_ACTIVE = 1 << 11
"""Statusword: an internal limit is active."""
_NMT_STOP = 2


@njit("boolean(int64[::1])", counted=False)
def _follows(s: NDArray[Any]) -> bool:
    """Whether the drive's demand is one of the latest commands, within a step and a half; or smaller, at a limit."""
    f = s.view(np.float64)
    demand = s[w.DEMAND] * f[w.AMPERE_PER_DEMAND]
    step = 1.5 * max(f[w.AMPERE_PER_DEMAND], 1.0 / f[w.COMMAND_PER_AMPERE])
    limited = s[w.STATUSWORD] & _LIMIT_ACTIVE != 0
    for kept in range(w.COMMANDS_KEPT):
        current = f[w.COMMANDED + kept]
        if abs(demand - current) <= step:
            return True
        if limited and min(current, 0.0) <= demand <= max(current, 0.0):
            return True
    return False


@njit("boolean(int64[::1])", counted=False)
def other_mode(s: NDArray[Any]) -> bool:
    """Whether the drive, in Operation enabled, is in another mode of operation than that set by bring-up."""
    return bool(s[w.MODE] != s[w.MODE_WANTED] and state_of(s[w.STATUSWORD]) == ENABLED)


@njit("int64(int64[::1])", counted=False)
def heard(s: NDArray[Any]) -> int:
    """Whether the drive follows its commands, from the demand that is read back: OK, MISSED, or LOST.

    Called once in each tick with a TPDO 1, before the tick's command.
    """
    if s[w.READ_BACK] == 0 or s[w.SAMPLED] == 0 or s[w.REASON] != 0:
        return OK
    s[w.SAMPLED] = 0
    s[w.DEMAND_SEEN] = s[w.DEMAND_FRESH]
    if state_of(s[w.STATUSWORD]) != ENABLED or (s[w.DEMAND_FRESH] == 1 and _follows(s)):
        s[w.UNHEARD] = 0
    else:
        s[w.UNHEARD] += 1
    s[w.DEMAND_FRESH] = 0
    if s[w.UNHEARD] >= w.UNHEARD_LIMIT:
        return LOST
    return MISSED if s[w.UNHEARD] > 1 else OK


@njit("boolean(int64[::1])", counted=False)
def stops_node(s: NDArray[Any]) -> bool:
    """Whether the drive must be stopped by NMT; the frame is then in OUT, once.

    This is so if commands are lost, or if another client has changed its settings, possibly its PDOs. The drive then acts
    as its abort connection option (0x6007) says. From now on it also gets no guarding message, so that its watchdog too
    leads to zero current.
    """
    if s[w.NODE_STOPPED] == 1 or s[w.REASON] not in (w.LOST_DEAF, w.LOST_WRITTEN, w.LOST_MODE):
        return False
    s[w.NODE_STOPPED] = 1
    s[w.OUT] = w.NMT | 2 << 32
    s[w.OUT + 1] = _NMT_STOP | s[w.NODE] << 8
    return True


@njit("void(int64[::1], int64)", counted=False)
def remember(s: NDArray[Any], target: int) -> None:
    """Store a raw target as the latest command."""
    f = s.view(np.float64)
    if s[w.REASON] != 0:
        return
    for kept in range(w.COMMANDS_KEPT - 1, 0, -1):
        f[w.COMMANDED + kept] = f[w.COMMANDED + kept - 1]
    f[w.COMMANDED] = target / f[w.COMMAND_PER_AMPERE]
