"""The problem that a model and recordings make, and the base model that may be fitted along with what it lacks."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import declared_latency
from hapticd.gap import constants
from hapticd.gap.late_record import LATEST
from hapticd.gap.missing import missing_power
from hapticd.gap.problem import Problem
from hapticd.gap.series import series_of
from hapticd.gap.terms import Coordinate, Term
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.layout import device_vector, index_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.config import Config
    from hapticd.gap.fit import Fit
    from hapticd.gap.recording import Recording

FARTHEST = {"inertia": 10.0, "viscous": 100.0, "coulomb": 100.0}
"""Factor by which a base parameter may leave its nominal value. A shaft heavier than that ignores the current."""
_MOST_WORK = 1.5
"""Work against Coulomb friction over what the shaft gets: beyond, friction holds it, and a disturbance moves it."""
_STEP_S = 0.05
"""Steps over which a way is summed [s]."""
NOTHING = 1e-6
"""What a friction that the model has not is instead, over the device's torques: nothing that shows."""


def problem_of(recordings: Sequence[Recording], model: Config, least: float = NOTHING) -> Problem:
    """What is fitted; a friction that the model has not is this share of the torque.

    Raises:
        ValueError: no recording.
    """
    series = series_of(recordings)
    vector = device_vector(model, declared_latency(model)[0])
    drive = model.amplifier.torque_constant * float(np.sqrt(np.mean(series.command**2)))
    way = series.resolution * float(np.ptp(series.cell))
    slowed = model.plant.inertia * way / series.duration_s**2  # all there is where a shaft without friction coasts
    torque = model.plant.coulomb + drive or slowed
    speed = series.resolution * float(np.abs(np.diff(series.cell)).sum()) / series.duration_s
    zero = [name for name in ("viscous", "coulomb") if vector[index_of(name)] == 0.0]
    begun = {name: least * torque / (speed if name == "viscous" else 1.0) for name in zero}
    for name, size in begun.items():
        vector[index_of(name)] = size
    return Problem(series, vector, torque, model.is_linear, begun)


def base_terms(problem: Problem, filter_s: float = 0.0) -> tuple[Term, ...]:
    """Terms that fit the base model: the logarithms of inertia, viscous and Coulomb friction, with a wide prior.

    Coulomb friction is at most `most_coulomb`, or what the model says if that is more.

    Args:
        problem: what is fitted. filter_s: time constant of a filter before the record of the current; 0 for none.
    """
    found = []
    for name, farthest in FARTHEST.items():
        index = index_of(name)
        given = float(problem.base[index])
        least, most = given / farthest, given * farthest
        if name == "coulomb":
            most = min(most, max(most_coulomb(problem, filter_s), given))
        centre, low, high = (math.log(size) for size in (given, least, most))
        neutral = math.nan if name == "inertia" else low  # next to no friction is none
        coordinate = Coordinate(name, index, True, low, high, 0.3, constants.BASE_PRIOR, centre, neutral)
        found.append(Term(name, (coordinate,), (centre,)))
    return tuple(found)


def from_the_end(first: Fit, last: Fit) -> Problem | None:
    """The problem to begin again with, of a base parameter at the end of the range to which it ran: a poor guess.

    None where none did, or where with the inertia within its range what is named explains what was missing all the same; and
    the second time, since what runs farther is no guess. The most that Coulomb friction may be is none either.

    Args:
        first: the nominal model. last: with all that is named.
    """
    problem, base, ended = last.problem, last.problem.base.copy(), []
    for number, term in enumerate(last.terms):
        own = last.columns(number)
        if term.slug in ("inertia", "viscous") and term.at_bounds(last.u[own]):
            ended.append(term.slug)
            base[index_of(term.slug)] = math.exp(last.u[own.start])
    is_explained = missing_power(last) < (1.0 - constants.EXPLAINED) * missing_power(first)
    if not problem.is_given or not ended or (is_explained and "inertia" not in ended):
        return None
    return replace(problem, base=base, is_given=False)


def most_coulomb(problem: Problem, filter_s: float = 0.0) -> float:
    """Coulomb friction that takes `_MOST_WORK` times what the shaft gets, N m or N.

    That is the current's work, of a current that acts up to `LATEST` periods before or after its record where that is more,
    and the energy with which each stretch begins, of a shaft as heavy as it may be.
    """
    series, p = problem.series, problem.base
    duration, current, _ = series.currents(p, filter_s)
    torque = torque_constant(p) * np.sum(duration * current, axis=1) / np.sum(duration, axis=1)
    inertia = FARTHEST["inertia"] * float(p[index_of("inertia")])
    work, energy, way = np.zeros(2 * LATEST + 1), 0.0, 0.0
    for rows in np.split(np.arange(series.size), np.flatnonzero(series.begins)[1:]):
        x, period_s = series.resolution * series.cell[rows], series.periods_s[series.recording[rows[0]]]
        every = max(round(_STEP_S / period_s), 1)
        steps = np.diff(x[::every])
        way += float(np.maximum(np.abs(steps) - series.resolution, 0.0).sum())  # an encoder's noise is no way
        if steps.size:
            energy += 0.5 * inertia * float(steps[0] / (every * period_s)) ** 2
        moved, n = np.diff(x), x.size - 1
        reach = min(LATEST, n - 1)  # a stretch between two gaps may be shorter
        for k in range(-reach, reach + 1):
            late, early = max(k, 0), max(-k, 0)
            work[k + LATEST] += torque[rows][early : n - late] @ moved[late : n - early]
    return _MOST_WORK * (max(float(work.max()), 0.0) + energy) / max(way, series.resolution)


def not_told(fit: Fit, half: np.ndarray[Any, np.dtype[np.float64]]) -> list[str]:
    """Base parameters that are not told from an end of the range that is fitted."""
    own = [(term, fit.columns(number)) for number, term in enumerate(fit.terms) if term.slug in FARTHEST]
    untold = [term.slug for term, columns in own if term.at_bounds(fit.u[columns], half[columns])]
    if not untold:
        return []
    return [
        f"These data do not tell {' and '.join(untold)} from the end of the range that is fitted: the model is of another "
        "device, or the motion is not the current's, as where a controller makes the current follow it. What is named "
        "depends on that."
    ]
