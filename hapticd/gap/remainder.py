"""What the named effects leave, in words: which coordinates it depends on, lines in time, orders in angle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.gap import chance, constants, ripple
from hapticd.gap.candidates import scale_of
from hapticd.gap.lines import frequencies, lines
from hapticd.gap.missing import Missing, missing_force, structure
from hapticd.gap.result import Remainder
from hapticd.gap.text import looks, percent

if TYPE_CHECKING:
    from hapticd.gap.fit import Fit

_LISTED = 3


def remainder_of(fit: Fit, found: Missing, power_before: float) -> Remainder:
    """What a model leaves.

    Args:
        fit: the model, held out. found: its missing force. power_before: of the missing force of the model as given.
    """
    share = min(found.rms**2 / power_before, 1.0) if power_before > 0.0 else 0.0
    entries: list[dict[str, Any]] = [
        {"coordinate": coordinate, "share": part * share, "p_value": p_value}
        for coordinate, part, p_value in dependences(fit, found)
    ]
    clauses = [looks(entry["coordinate"], linear=fit.problem.is_linear) for entry in entries[:_LISTED]]
    fingerprint = [f"a line at {frequency:.3g} Hz in time" for frequency in frequencies(fit)]
    for order in ripple.orders_left(fit, scale_of(fit)):
        period_m = 2.0 * math.pi / order
        along = f"a period of {period_m:.3g} m in position" if fit.problem.is_linear else f"order {order:.3g} in angle"
        fingerprint.append(along)
    clauses += fingerprint
    left = f"{percent(share)} of the missing force's power is left"
    if clauses:
        text = f"{left}: {'; '.join(clauses)}."
    else:
        text = f"{left}; it depends on nothing that was looked at." if share > constants.STRUCTURE_SHARE else f"{left}."
    return Remainder(share, text, tuple(entries), tuple(fingerprint))


def dependences(fit: Fit, found: Missing) -> list[tuple[str, float, float]]:
    """Coordinates that what a model leaves surely depends on, the most telling first.

    Returns:
        For each: its name, its share of the power of what is left, and how unlikely that is by chance.
    """
    tested = structure(fit, found)
    blocks = fit.problem.series.blocks
    needed = chance.standard_errors(constants.LEVEL / max(len(tested), 1), blocks)
    sure = [test for test in sorted(tested, key=lambda test: -test.gain) if test.errors > needed]
    parts = [min(float(np.mean(test.force[found.moves] ** 2)) / found.rms**2, 1.0) for test in sure]
    return [
        (test.coordinate, part, min(chance.exceeding(test.errors, blocks) * len(tested), 1.0))
        for test, part in zip(sure, parts, strict=True)
        if part > constants.STRUCTURE_SHARE
    ]


def is_all_chance(fit: Fit) -> bool:
    """Whether a model, held out, leaves nothing but chance: then even a small law that is sure is no stand-in."""
    return not dependences(fit, missing_force(fit)) and not lines(fit)
