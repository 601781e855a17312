"""Unnamed functions of one coordinate, which compete with the laws of the catalogue."""

from __future__ import annotations

from dataclasses import replace

from hapticd.gap.law_set import LawSet, scored
from hapticd.gap.missing import missing_force, structure


def with_function(reduced: LawSet, tolerance: float) -> LawSet | None:
    """A set with the flexible function of one coordinate that gains most; None if the shaft never moves.

    The held-out torque of the function is added to the set, which is fitted again. Its parameters count as those of a law.

    Args:
        reduced: the set without it. tolerance: of the ascent, nats.
    """
    functions = structure(reduced.fit, missing_force(reduced.fit))
    if not functions:
        return None
    best = max(functions, key=lambda function: function.gain)
    fit = reduced.fit.with_torque(best.held_out).maximise(tolerance=tolerance)
    return replace(scored(fit, reduced.penalty), function=best.coordinate, function_numbers=best.numbers)
