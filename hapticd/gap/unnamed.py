"""Flexible functions of one coordinate in the place of a law: where one predicts as well, the law may be another."""

from __future__ import annotations

from hapticd.gap import constants
from hapticd.gap.law_set import LawSet, evidence, scored
from hapticd.gap.missing import missing_force, structure


def better_function(before: LawSet, with_it: LawSet, numbers: int, tolerance: float) -> str | None:
    """The coordinate of which a flexible function takes the place of a law, or None.

    Its torque, each block's without its fold, acts on the set without the law, which climbs. It predicts better than the
    law, or as well with no more numbers.

    Args:
        before: the set without the law. with_it: with it. numbers: how many the law has. tolerance: of the climb, nats.
    """
    functions = structure(before.fit, missing_force(before.fit))
    if not functions:
        return None
    best = max(functions, key=lambda function: function.gain)
    fit = before.fit.under(best.held_out).maximise(tolerance=tolerance)
    ahead = evidence(scored(fit, before.penalty), with_it)[1]
    is_simpler = best.numbers <= numbers
    return best.coordinate if ahead > (-1.0 if is_simpler else 1.0) * constants.INDISTINGUISHABLE else None
