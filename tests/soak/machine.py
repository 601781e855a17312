"""How much of the processors goes to work that is not the soak's: what else runs on the machine, and what its host takes."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Final

SPAN_S: Final = 5.0
MUCH: Final = 0.5
"""From this share of a processor on, others may make a daemon late."""
_TICK_S: Final = 1.0 / os.sysconf("SC_CLK_TCK")
_STAT: Final = Path("/proc/stat")


def busy_s(stat: str) -> float:
    """Time of all processors since the boot that was not idle, s; ``stat`` as ``/proc/stat`` says."""
    user, nice, system, _idle, _waiting, interrupts, soft_interrupts, stolen = map(
        int, stat.split("\n")[0].split()[1:9]
    )
    return (user + nice + system + interrupts + soft_interrupts + stolen) * _TICK_S


def _spent_s(process: int) -> float:
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) * _TICK_S


class Others:
    """Looks what others take; `share` is their part of one processor over the last seconds."""

    def __init__(self) -> None:
        self._looks: deque[tuple[float, float]] = deque()

    def look(self, processes: Iterable[int]) -> None:
        """Look now; ``processes`` are the soak's."""
        now_s = time.monotonic()
        self._looks.append((now_s, busy_s(_STAT.read_text()) - sum(map(_spent_s, processes))))
        while self._looks[0][0] < now_s - SPAN_S:
            self._looks.popleft()

    @property
    def share(self) -> float:
        """Of one processor; 0 before the second look."""
        if len(self._looks) < 2:
            return 0.0
        (began_s, before), (now_s, after) = self._looks[0], self._looks[-1]
        return max(0.0, (after - before) / (now_s - began_s))
