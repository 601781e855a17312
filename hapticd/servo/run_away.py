"""Detection of a run-away by a wrong sign: the shaft only moves away from the origin, against the current."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.record.schema import FLAG_RUNNING
from hapticd.servo import faults

SUSPECT: Final = (
    "from the first tick on the shaft moved away from the origin, ever faster, although the current should bring it back: "
    "most likely the sign is wrong (encoder.invert, or the motor's leads)"
)
_PAST_S: Final = 2.0
"""A wrong sign runs away within tenths of a second."""
_FEWEST: Final = 4
_GROWTH: Final = 2.0


def detail(number: int, core: Any, origin_counts: int) -> str | None:
    """Additional text for a fault, from the last rows of its loop; None for none.

    Args:
        number: of the fault. core: the loop (:class:`hapticd.servo.core.ServoCore`). origin_counts: the spring's.
    """
    if number not in (faults.OVER_SPEED, faults.EXCURSION):
        return None
    return SUSPECT if sign_is_suspect(core.history(_PAST_S), origin_counts) else None


def sign_is_suspect(rows: NDArray[Any], origin_counts: int) -> bool:
    """Whether the last motion in some rows is impossible for a spring of the right sign.

    An unstable spring oscillates, and a release begins towards the origin. A hand that pulls this fast, and ever faster from
    the first tick on, cannot be distinguished.

    Args:
        rows: structured (:data:`hapticd.record.schema.ROW`), oldest first; the last run of FLAG_RUNNING is looked at.
        origin_counts: the spring's origin, counts.
    """
    running = np.flatnonzero(rows["flags"] & FLAG_RUNNING)
    if len(running) < _FEWEST:
        return False
    begin = running[np.flatnonzero(np.diff(running) > 1)[-1] + 1] if np.any(np.diff(running) > 1) else running[0]
    run = rows[begin : running[-1] + 2]  # the sample of the fault itself follows
    away = run["encoder_counts"].astype(float) - origin_counts
    away *= np.sign(away[-1])
    steps = np.diff(away)
    current = run["current_command_A"][:-1] * np.sign(run["encoder_counts"][-1] - origin_counts)
    half = len(steps) // 2
    only_away = bool(np.all(steps >= -1.0) and away[0] >= -1.0)
    faster = steps[half:].sum() > _GROWTH * max(1.0, steps[:half].sum())
    return bool(only_away and faster and np.all(current <= 0.0) and current.min() < 0.0)
