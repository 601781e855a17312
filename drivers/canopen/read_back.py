"""Whether the drive takes its commands: what comes back in TPDO 2 against the latest commands and the mode, compiled.

A drive that hears SYNC and guarding, but no RPDO, keeps its last current, and nothing else would notice. As long as the
commands do not change that current is the right one; once they do, the demand shows it.
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
    """Whether the drive's demand is one of the latest commands, to a step and a half; or less than one, at a limit."""
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
    """Whether the drive, in Operation enabled, is in another mode of operation than the one that bring-up has set."""
    return bool(s[w.MODE] != s[w.MODE_WANTED] and state_of(s[w.STATUSWORD]) == ENABLED)


@njit("int64(int64[::1])", counted=False)
def heard(s: NDArray[Any]) -> int:
    """Whether the drive takes its commands, by the demand that it sends back: OK, MISSED, or LOST for good.

    Asked once a tick that had its TPDO 1, before the tick's own command.
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
    """Whether a drive that may not take its commands has to be stopped by NMT; the frame is then in OUT, once.

    So it is where commands are lost, and where somebody else has changed its settings, of which its PDOs are some. The
    drive does on that what its abort connection option (0x6007) says. From here on it gets no sign of life either: its
    watchdog is the second way to zero current.
    """
    if s[w.NODE_STOPPED] == 1 or s[w.REASON] not in (w.LOST_DEAF, w.LOST_WRITTEN, w.LOST_MODE):
        return False
    s[w.NODE_STOPPED] = 1
    s[w.OUT] = w.NMT | 2 << 32
    s[w.OUT + 1] = _NMT_STOP | s[w.NODE] << 8
    return True


@njit("void(int64[::1], int64)", counted=False)
def remember(s: NDArray[Any], target: int) -> None:
    """Keep a raw target as the latest command."""
    f = s.view(np.float64)
    if s[w.REASON] != 0:
        return
    for kept in range(w.COMMANDS_KEPT - 1, 0, -1):
        f[w.COMMANDED + kept] = f[w.COMMANDED + kept - 1]
    f[w.COMMANDED] = target / f[w.COMMAND_PER_AMPERE]
