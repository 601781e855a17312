"""What the named effects leave, in words: which coordinates it depends on, and lines in time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import welch
from scipy.stats import t as student

from hapticd.gap import constants
from hapticd.gap.missing import Missing, structure
from hapticd.gap.result import Remainder
from hapticd.gap.words import SHOWS_AS, percent

if TYPE_CHECKING:
    from hapticd.gap.fit import Fit

_TOLD = 3
_SEGMENT = 4096
_FEWEST = 8
_LINE = 25.0
"""Power over that of the neighbourhood at which a frequency is a line."""


def remainder_of(fit: Fit, found: Missing, power_before: float) -> Remainder:
    """What a model leaves.

    Args:
        fit: the model, held out. found: its missing force. power_before: of the missing force of the model as given.
    """
    share = min(found.rms**2 / power_before, 1.0) if power_before > 0.0 else 0.0
    tested = structure(fit, found)
    entries: list[dict[str, Any]] = []
    needed = student.isf(constants.LEVEL / max(len(tested), 1), fit.problem.series.blocks - 1)
    for test in sorted(tested, key=lambda test: -test.gain):
        part = float(np.mean(test.force[found.moves] ** 2)) / power_before if power_before > 0.0 else 0.0
        if test.errors > needed and min(part, share) > constants.STRUCTURE_SHARE:
            p_value = float(student.sf(test.errors, fit.problem.series.blocks - 1)) * len(tested)
            entries.append({"coordinate": test.coordinate, "share": min(part, share), "p_value": min(p_value, 1.0)})
    words = [SHOWS_AS[entry["coordinate"]] for entry in entries[:_TOLD]]
    words += [f"a line at {frequency:.3g} Hz in time" for frequency in lines(fit)]
    left = f"{percent(share)} of the missing force's power is left"
    if words:
        text = f"{left}: {'; '.join(words)}."
    else:
        text = f"{left}; it depends on nothing that was looked at." if share > constants.STRUCTURE_SHARE else f"{left}."
    return Remainder(share, text, tuple(entries))


def lines(fit: Fit) -> list[float]:
    """Frequencies [Hz] at which the innovations of a model have a line, the strongest first."""
    series = fit.problem.series
    deviation = np.sqrt(np.maximum(fit.out["variance"] * fit.out["share"], 1e-300))
    innovation = np.clip(fit.out["moved"] / deviation, -5.0, 5.0)
    if series.size < _FEWEST * _SEGMENT // 2:
        return []
    frequency, power = welch(innovation, 1.0 / series.period_s, nperseg=_SEGMENT)
    width = 50
    around = np.array([np.median(power[max(k - width, 0) : k + width]) for k in range(power.size)])
    found: list[float] = []
    ratio = np.where(frequency > 5.0, power / around, 0.0)
    while ratio.max() > _LINE and len(found) < _TOLD:
        k = int(np.argmax(ratio))
        found.append(float(frequency[k]))
        ratio[max(k - width // 5, 0) : k + width // 5] = 0.0
    return found
