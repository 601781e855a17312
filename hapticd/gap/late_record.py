"""A late or filtered record of the current: the current acted on the motor before its time stamp.

It is a negative delay, or a negative lag. It competes with the laws, because it acts like friction where a spring is
rendered. It is a fault of the record and not of the device, so once chosen, it is in every further fit. A device with less
delay than its model is not identifiable from it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.terms import RECORD_FILTER, Coordinate, Term
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.fit import Fit

SLUG = "late_record"
_DELAY, _LAG = "transport_delay", "amplifier_lag"
"""The effects with the opposite sign: only the difference of the two is identifiable."""
OPPOSITES = (_DELAY, _LAG)
_PERIODS = (0.1, 0.3, 1.0, 2.0, 4.0, 8.0)
LATEST = 20
"""Largest lateness of a record, in periods."""
_FILTERS = (1.0, 3.0, 10.0, 30.0, 100.0)
_LEAST_FILTER, _MOST_FILTER = 0.1, 1e3
"""Least and largest time constant of a filter, in periods."""


def starts(slug: str, period_s: float) -> list[Term]:
    """Terms of a late or filtered record, as the opposite of an effect; empty for most effects."""
    if slug == _DELAY:
        delay = Coordinate("t_d", index_of(f"{_DELAY}.t_d"), False, -LATEST * period_s, 0.0, period_s)
        return [Term(slug, (delay,), (-periods * period_s,)) for periods in _PERIODS]
    if slug == _LAG:
        ends = math.log(_LEAST_FILTER * period_s), math.log(_MOST_FILTER * period_s)
        filtering = Coordinate(RECORD_FILTER, -1, True, *ends, 0.5)
        return [Term(slug, (filtering,), (math.log(periods * period_s),)) for periods in _FILTERS]
    return []


def is_late(law: Term) -> bool:
    """Whether a law is a late or filtered record."""
    if law.slug == _DELAY:
        return not law.coordinates[0].is_log  # a delay of the device is a positive magnitude
    return law.slug == _LAG and law.coordinates[0].name == RECORD_FILTER


def identifiable(slugs: Sequence[str], law: Term) -> list[str]:
    """The laws that remain identifiable with a late or filtered record.

    Such a record is of the current, not of the command, so it does not contain the times of commands. A filtered record
    already contains all effects between command and current. It may also be late, so the delay stays, with negative
    sign only (`is_opposite_only`).
    """
    if law.coordinates[0].name != RECORD_FILTER:
        return [slug for slug in slugs if CATALOGUE[slug].acts_on != "timing"]
    return [slug for slug in slugs if slug == _DELAY or CATALOGUE[slug].acts_on not in ("input", "timing")]


def not_considered(slugs: Sequence[str], left: Sequence[str]) -> list[str]:
    """A sentence for each requested effect that can no longer be considered."""
    gone = [slug for slug in slugs if slug not in left]
    return [
        f"{slug} cannot be considered: the recorded current is late or filtered, and not the command" for slug in gone
    ]


def is_opposite_only(slug: str, fit: Fit) -> bool:
    """Whether only the opposite of an effect is identifiable: of a delay, if the record is filtered."""
    return slug == _DELAY and fit.filter_s() > 0.0


def record_term(law: Term) -> Term:
    """The term of a late record in every further fit.

    Its prior keeps it near the estimate: with more laws it could drift anywhere.
    """
    (own,), (found,) = law.coordinates, law.start
    return Term(SLUG, (replace(own, prior=own.scale, centre=found),), law.start)


def described(fit: Fit, variance: Any, coverage: float) -> dict[str, Any]:
    """``current_late_s`` and ``current_filter_s``, each with a warning, if the record is significantly late or filtered.

    Args:
        fit: the final model. variance: (k,) of its coordinates. coverage: coverage factor of a 95 % interval.
    """
    found: dict[str, Any] = {"warnings": []}
    for number, item in enumerate(fit.terms):
        if item.slug != SLUG:
            continue
        at = fit.columns(number).start
        half = coverage * float(variance[at]) ** 0.5
        if item.coordinates[0].name == RECORD_FILTER:
            if item.at_bounds(fit.u[fit.columns(number)], half):
                continue
            filter_s, low, high = (math.exp(fit.u[at] + error) for error in (0.0, -half, half))
            found["current_filter_s"] = {"value": filter_s, "ci95": [low, high]}
            found["warnings"].append(
                f"the current was filtered before it was recorded, with a time constant of {1e3 * filter_s:.3g} ms "
                f"({1e3 * low:.3g} to {1e3 * high:.3g} ms), or its record lags by as much for another reason. It is in the "
                "fit."
            )
            continue
        late_s = -float(fit.u[at])
        low, high = late_s - half, late_s + half
        if low > 0.0:
            found["current_late_s"] = {"value": late_s, "ci95": [low, high]}
            found["warnings"].append(
                f"the current is recorded {1e3 * late_s:.3g} ms late ({1e3 * low:.3g} to {1e3 * high:.3g} ms), or the "
                "current changes between samples, or the device has so much less delay than the model: these data do not "
                "distinguish them. It is in the fit."
            )
    return found
