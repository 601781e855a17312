"""The remainder in words: which coordinates it depends on, lines in time, orders in angle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hapticd.gap import chance, constants, ripple
from hapticd.gap.candidates import scale_of
from hapticd.gap.lines import frequencies
from hapticd.gap.missing import Dependence, Missing, dependences
from hapticd.gap.result import Remainder
from hapticd.gap.text import dependence_in_words, percent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.fit import Fit

_LISTED = 3


def remainder_of(fit: Fit, found: Missing, power_before: float) -> Remainder:
    """The remainder of a model.

    Args:
        fit: the model, held out. found: its missing force. power_before: missing power of the given model.
    """
    share = min(found.rms**2 / power_before, 1.0) if power_before > 0.0 else 0.0
    table = dependences(fit, found)
    sure, blocks = sure_of(table, fit.problem.series.blocks), fit.problem.series.blocks
    entries: list[dict[str, Any]] = [
        {
            "coordinate": entry.coordinate,
            "share": entry.share * share,
            "p_value": min(chance.exceeding(entry.errors, blocks) * len(table), 1.0),
        }
        for entry in sorted(sure, key=lambda entry: -entry.errors)
    ]
    linear = fit.problem.is_linear
    clauses = [dependence_in_words(entry["coordinate"], linear=linear) for entry in entries[:_LISTED]]
    fingerprint = [f"a line at {frequency:.3g} Hz in time" for frequency in frequencies(fit)]
    for order in ripple.orders_left(fit, scale_of(fit)):
        period_m = 2.0 * math.pi / order
        fingerprint.append(f"a period of {period_m:.3g} m in position" if linear else f"order {order:.3g} in angle")
    clauses += fingerprint
    left = f"{percent(share)} of the missing force's power is left"
    if clauses:
        text = f"{left}: {'; '.join(clauses)}."
    elif table and table[0].share > constants.STRUCTURE_SHARE and share > constants.STRUCTURE_SHARE:
        most = dependence_in_words(table[0].coordinate, linear=linear)
        text = f"{left}; {percent(table[0].share)} of that may be {most}, which is not sure."
    else:
        text = f"{left}; it depends on no coordinate." if share > constants.STRUCTURE_SHARE else f"{left}."
    return Remainder(share, text, tuple(entries), tuple(fingerprint))


def sure_of(table: Sequence[Dependence], blocks: int) -> list[Dependence]:
    """The entries that are significant and large enough to be structure."""
    needed = chance.standard_errors(constants.LEVEL / max(len(table), 1), blocks)
    return [entry for entry in table if entry.errors > needed and entry.share > constants.STRUCTURE_SHARE]
