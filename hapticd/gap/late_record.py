"""A record of the current that is late or filtered: the motor had each current before the record says so.

That is a delay, or a lag, below zero. It competes with the laws, since it acts like friction where a spring is rendered;
but it belongs to the record and not to the device, so once it is chosen, every set of laws is fitted with it. A device that
answers sooner than its model says, or both at once, cannot be distinguished.
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
"""The effects of the catalogue that it is the opposite of: data show no more than the difference of the two."""
OPPOSITES = (_DELAY, _LAG)
_PERIODS = (0.1, 0.3, 1.0, 2.0, 4.0, 8.0)
LATEST = 20
"""Longest that a record may be late, in periods."""
_FILTERS = (1.0, 3.0, 10.0, 30.0, 100.0)
_LEAST_FILTER, _MOST_FILTER = 0.1, 1e3
"""Time constants of a filter, in periods."""


def starts(slug: str, period_s: float) -> list[Term]:
    """Terms of an effect that mean a late or filtered record, its opposite; none of most effects."""
    if slug == _DELAY:
        delay = Coordinate("t_d", index_of(f"{_DELAY}.t_d"), False, -LATEST * period_s, 0.0, period_s)
        return [Term(slug, (delay,), (-periods * period_s,)) for periods in _PERIODS]
    if slug == _LAG:
        ends = math.log(_LEAST_FILTER * period_s), math.log(_MOST_FILTER * period_s)
        filtering = Coordinate(RECORD_FILTER, -1, True, *ends, 0.5)
        return [Term(slug, (filtering,), (math.log(periods * period_s),)) for periods in _FILTERS]
    return []


def is_late(law: Term) -> bool:
    """Whether a law that was found is a late or filtered record."""
    if law.slug == _DELAY:
        return not law.coordinates[0].is_log  # a delay of the device is a positive magnitude
    return law.slug == _LAG and law.coordinates[0].name == RECORD_FILTER


def untouched(slugs: Sequence[str], law: Term) -> list[str]:
    """Those laws that data still show where the record is late or filtered.

    A late record is of the current and not of the command, so it does not show when commands were sent. Of a filtered one
    the same holds, and all that comes between a command and its current is in the record already. It may be late besides,
    so the delay that lateness is the opposite of stays, for that alone (`is_opposite_only`).
    """
    if law.coordinates[0].name != RECORD_FILTER:
        return [slug for slug in slugs if CATALOGUE[slug].acts_on != "timing"]
    return [slug for slug in slugs if slug == _DELAY or CATALOGUE[slug].acts_on not in ("input", "timing")]


def not_considered(slugs: Sequence[str], left: Sequence[str]) -> list[str]:
    """A sentence for each effect that was asked for and can no longer be considered."""
    gone = [slug for slug in slugs if slug not in left]
    return [
        f"{slug} cannot be considered: the record is not of the command, but of a late or filtered current"
        for slug in gone
    ]


def is_opposite_only(slug: str, fit: Fit) -> bool:
    """Whether of an effect only the opposite may be found: of a delay, where the record is filtered."""
    return slug == _DELAY and fit.filter_s() > 0.0


def along(law: Term) -> Term:
    """The term that fits a late record along with everything else.

    It stays near where it was found, with laws that a poorer model has not: there it would run anywhere.
    """
    (own,), (found,) = law.coordinates, law.start
    return Term(SLUG, (replace(own, prior=own.scale, centre=found),), law.start)


def described(fit: Fit, variance: Any, reach: float) -> dict[str, Any]:
    """``current_late_s`` and ``current_filter_s``, and a warning of each, where a record is surely late or filtered.

    Args:
        fit: the last model. variance: (k,) of its coordinates. reach: standard errors to the ends of a 95 % interval.
    """
    found: dict[str, Any] = {"warnings": []}
    for number, item in enumerate(fit.terms):
        if item.slug != SLUG:
            continue
        at = fit.columns(number).start
        half = reach * float(variance[at]) ** 0.5
        if item.coordinates[0].name == RECORD_FILTER:
            if item.at_bounds(fit.u[fit.columns(number)], half):
                continue
            filter_s, low, high = (math.exp(fit.u[at] + error) for error in (0.0, -half, half))
            found["current_filter_s"] = {"value": filter_s, "ci95": [low, high]}
            found["warnings"].append(
                f"the current was filtered before it was recorded, with a time constant of {1e3 * filter_s:.3g} ms "
                f"({1e3 * low:.3g} to {1e3 * high:.3g} ms), or the motor's current is ahead of its record by so much "
                "for another reason. It is fitted too."
            )
            continue
        late_s = -float(fit.u[at])
        low, high = late_s - half, late_s + half
        if low > 0.0:
            found["current_late_s"] = {"value": late_s, "ci95": [low, high]}
            found["warnings"].append(
                f"the current is recorded {1e3 * late_s:.3g} ms late ({1e3 * low:.3g} to {1e3 * high:.3g} ms), or it is "
                "a sample of a current that changes in between, or the device answers by so much sooner than the model "
                "says: these data do not distinguish them. It is fitted too."
            )
    return found
