"""A record of the current that is late or filtered: the motor had each current before the record says so.

That is a delay below zero. It competes with the effects, since it looks like friction where a spring is rendered; but it
belongs to the record and not to the device, so once it has won, every hypothesis fits it along, as it does base parameters.
A device that answers sooner than its model says, or both at once, look the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hapticd.gap.terms import Coordinate, Term
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from hapticd.gap.fit import Fit

SLUG = "late_record"
DELAY = "transport_delay"
"""The effect of the catalogue that it is the opposite of: data tell no more than the difference of the two."""
_PERIODS = (0.1, 0.3, 1.0, 2.0, 4.0, 8.0)
_LATEST = 20.0
"""Longest that a record may be late, in periods."""


def starts(period_s: float) -> list[Term]:
    """Terms of the effect `DELAY` that stand for a late record."""
    coordinate = Coordinate("t_d", index_of(f"{DELAY}.t_d"), False, -_LATEST * period_s, 0.0, period_s)
    return [Term(DELAY, (coordinate,), (-periods * period_s,)) for periods in _PERIODS]


def is_late(law: Term) -> bool:
    """Whether a law that was found is a late record."""
    return law.slug == DELAY and not law.coordinates[0].is_log  # a delay of the device is a positive magnitude


def along(law: Term) -> Term:
    """The term that fits a late record along with everything else."""
    return Term(SLUG, law.coordinates, law.start)


def described(fit: Fit, variance: Any, reach: float) -> dict[str, Any]:
    """``current_late_s`` and a warning where a record is surely late.

    Args:
        fit: the last model. variance: (k,) of its coordinates. reach: standard errors to the ends of a 95 % interval.
    """
    for number, item in enumerate(fit.terms):
        if item.slug == SLUG:
            at = fit.columns(number).start
            late_s, error = -float(fit.u[at]), float(variance[at]) ** 0.5
            low, high = late_s - reach * error, late_s + reach * error
            if low > 0.0:
                warning = (
                    f"the current is recorded {1e3 * late_s:.3g} ms late ({1e3 * low:.3g} to {1e3 * high:.3g} ms), or it is "
                    "a sample of a current that changes in between, or the device answers by so much sooner than the model "
                    "says: these data cannot tell. It is fitted along."
                )
                return {"current_late_s": {"value": late_s, "ci95": [low, high]}, "warnings": [warning]}
    return {"warnings": []}
