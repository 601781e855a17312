"""Case b of Fig. 8: which oscillations it can settle on, and how far that depends on where it starts."""

from __future__ import annotations

import math
from typing import Any, Final

from hapticd.reproduce.release import Release, neighbours, oscillation
from hapticd.stability.limit_cycle import predicted_cycle
from hapticd.stability.locked_cycle import locked_cycles

#: Releases within so many coarse ticks of the case's are looked at.
SPREAD: Final = 0.01


def buzz(run: Release, count: int) -> dict[str, Any]:
    """What the run settles on, what it could settle on, and what the describing function says.

    Args:
        run: case b.
        count: how many releases within ±`SPREAD` ticks to look at.
    """
    amplitude, frequency = oscillation(run)
    predicted = predicted_cycle(run.numbers)
    assert predicted is not None
    around, rate = neighbours(run.case, SPREAD, count), run.case.rate_hz
    exact = [{"periods": 2 * c.half_period, "amplitude_ticks": c.amplitude} for c in locked_cycles(run.numbers)]
    return {
        "amplitude_ticks": amplitude, "amplitude_counts": amplitude * run.case.decimation, "frequency_hz": frequency,
        "predicted_amplitude_ticks": predicted.amplitude,
        "predicted_frequency_hz": predicted.omega * rate / (2.0 * math.pi),
        "neighbours_amplitude_ticks": [float(around["amplitude"].min()), float(around["amplitude"].max())],
        "neighbours_frequency_hz": [float(f(around["omega"])) * rate / (2.0 * math.pi) for f in (min, max)],
        "locked_cycles": exact,
    }  # fmt: skip
