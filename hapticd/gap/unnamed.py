"""Unnamed functions of one coordinate: they compete with a law of the catalogue for its place in a set, as any other law."""

from __future__ import annotations

from dataclasses import replace

from hapticd.gap.law_set import LawSet, scored
from hapticd.gap.missing import missing_force, structure


def with_function(poorer: LawSet, tolerance: float) -> LawSet | None:
    """A set with the flexible function of one coordinate that gains most; None where the shaft never moves.

    Its torque, each block's without its fold, acts on the set, which is maximised. Its numbers count as those of a law do.

    Args:
        poorer: the set without it. tolerance: of the ascent, nats.
    """
    functions = structure(poorer.fit, missing_force(poorer.fit))
    if not functions:
        return None
    best = max(functions, key=lambda function: function.gain)
    fit = poorer.fit.under(best.held_out).maximise(tolerance=tolerance)
    return replace(scored(fit, poorer.penalty), function=best.coordinate, function_numbers=best.numbers)
