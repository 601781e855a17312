"""The fitting problem of a model and recordings, and its base parameters: inertia, viscous and Coulomb friction.

Base parameters are fitted first. They start from the model's values and from a least-squares balance of forces. A value
outside the model's uncertainty counts as a law, and the selection decides on it as on any law.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from drivers import declared_latency
from hapticd.gap import constants
from hapticd.gap._problem import Problem
from hapticd.gap.balance import balance
from hapticd.gap.errors import RecordingError
from hapticd.gap.inertia_range import inertia_range
from hapticd.gap.late_record import LATEST
from hapticd.gap.missing import missing_power
from hapticd.gap.series import series_of
from hapticd.gap.terms import BASE_WORDS, Coordinate, Term
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.layout import device_vector, index_of
from hapticd.plant.numeric import edited_base

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hapticd.config import Config
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit
    from hapticd.gap.inertia_range import InertiaRange
    from hapticd.gap.recording import Recording

FARTHEST = {"inertia_error": 10.0, "viscous_friction": 100.0, "coulomb_friction": 100.0}
"""Largest factor between a base parameter and the values of model and balance. A heavier shaft would not move."""
_MOST_WORK = 1.5
"""Largest ratio of friction work to the energy put into the shaft. Beyond it, only the disturbance would move the shaft."""
_PARTED = 1.25
"""An inertia contradicts the range of a balance if it is outside by more than this factor."""
_ACCURACY = 0.03
"""Best relative accuracy of an inertia from a balance: the filter and quantisation bias it by some per cent."""
_STEP_S = 0.05
"""Time step over which the distance travelled is summed [s]."""
NOTHING = 1e-6
"""Friction assumed where the model has none, relative to the device's torques: too small to have an effect."""


def problem_of(recordings: Sequence[Recording], model: Config) -> Problem:
    """The fitting problem.

    Raises:
        ValueError: no recording.
    """
    series = series_of(recordings)
    vector = device_vector(model, declared_latency(model)[0])
    drive = model.amplifier.torque_constant * float(np.sqrt(np.mean(series.command**2)))
    way = series.resolution * float(np.ptp(series.cell))
    slowed = model.plant.inertia * way / series.duration_s**2  # for a shaft that coasts without friction or current
    torque = model.plant.coulomb + drive or slowed
    speed = series.resolution * float(np.abs(np.diff(series.cell)).sum()) / series.duration_s
    zero = [name for name in ("viscous", "coulomb") if vector[index_of(name)] == 0.0]
    assumed_friction = {name: NOTHING * torque / (speed if name == "viscous" else 1.0) for name in zero}
    for name, size in assumed_friction.items():
        vector[index_of(name)] = size
    return Problem(series, vector, torque, model.is_linear, assumed_friction)


@dataclass(frozen=True)
class Balanced:
    """Base parameters from a balance of forces.

    Attributes:
        values: slug of the law to value; empty where the shaft hardly moves, or moves against the current.
        inertia: its range; None where it is not identifiable.
    """

    values: Mapping[str, float]
    inertia: InertiaRange | None = None

    def contradicts(self, fit: Fit) -> bool:
        """Whether a fitted inertia is out of range although the balance has a smaller residual.

        The best prediction one step ahead may have a wrong inertia: a too large inertia with a too large disturbance
        predicts slow motion as well.
        """
        if self.inertia is None or missing_power(fit) <= self.inertia.left**2:
            return False
        inertia = float(edited_base(fit.device())[0])
        return not self.inertia.low / _PARTED < inertia < self.inertia.high * _PARTED


def balanced(recordings: Sequence[Recording], model: Config) -> Balanced:
    """Inertia and friction by least squares on the balance of forces."""
    try:
        found = balance(recordings, model.amplifier.torque_constant)
    except RecordingError:
        return Balanced({})
    values = {slug: float(getattr(found, name)) for slug, name in BASE_WORDS.items()}
    if found.sign < 0 or any(value <= 0.0 for value in values.values()):
        return Balanced({})
    inertia = inertia_range(recordings, model.amplifier.torque_constant)
    if inertia.high > 0.0:
        values["inertia_error"] = min(max(values["inertia_error"], inertia.low), inertia.high)
    return Balanced(values, inertia)


def base_law(
    problem: Problem,
    slug: str,
    value: float | None = None,
    filter_s: float = 0.0,
    balanced: float | None = None,
    held: InertiaRange | None = None,
) -> Term:
    """The law that a base parameter differs from the model. Its coordinate is the logarithm, with a wide prior.

    The range is `FARTHEST` around the values of model and balance; a friction is at most `most_friction`, or the model's
    value if that is larger.

    Args:
        problem: what is fitted. slug: one of `BASE_WORDS`. value: start; by default the model's value.
        filter_s: time constant of a filter between the current and its record; 0 for none.
        balanced: value from a balance of forces, if any. held: range to which an inertia is limited, if any.
    """
    index = index_of(BASE_WORDS[slug])
    given = float(problem.base[index])
    start = given if value is None else value
    said = (given, start, given if balanced is None else balanced)
    least, most = min(said) / FARTHEST[slug], max(said) * FARTHEST[slug]
    if slug != "inertia_error":
        coulomb, viscous = most_friction(problem, filter_s)
        most = min(most, max(coulomb if slug == "coulomb_friction" else viscous, given))
    if held is not None:
        middle = math.sqrt(max(held.low, least) * min(held.high, most))
        least = max(least, min(held.low, middle / (1.0 + _ACCURACY)))
        most = min(most, max(held.high, middle * (1.0 + _ACCURACY)))
    centre, begin, low, high = (math.log(size) for size in (given, start, least, most))
    neutral = math.nan if slug == "inertia_error" else low  # the least friction counts as none
    coordinate = Coordinate("r", index, True, low, high, 0.3, constants.BASE_PRIOR, centre, neutral)
    return Term(slug, (coordinate,), (min(max(begin, low), high),))


def known_terms(problem: Problem, model: Config) -> tuple[Term, ...]:
    """Base parameters with an uncertainty in the model: they are fitted with it as prior, and do not count as laws."""
    found = []
    for slug, name in BASE_WORDS.items():
        deviation = float(getattr(model.plant.uncertainty, name))
        if deviation > 0.0 and name not in problem.assumed_friction:
            (own,) = (law := base_law(problem, slug)).coordinates
            prior = deviation / float(problem.base[own.word])
            found.append(replace(law, slug=name, coordinates=(replace(own, name=name, prior=prior),)))
    return tuple(found)


def most_friction(problem: Problem, filter_s: float = 0.0) -> tuple[float, float]:
    """Upper bounds of Coulomb and viscous friction: each dissipates `_MOST_WORK` times the energy put into the shaft.

    That energy is the work of the current, shifted by up to `LATEST` periods where that gives more, and the kinetic energy
    at the start of each stretch, for the largest inertia.
    """
    series, p = problem.series, problem.base
    duration, current, _ = series.currents(p, filter_s)
    torque = torque_constant(p) * np.sum(duration * current, axis=1) / np.sum(duration, axis=1)
    inertia = FARTHEST["inertia_error"] * float(p[index_of("inertia")])
    work, energy, way, square = np.zeros(2 * LATEST + 1), 0.0, 0.0, 0.0
    for rows in np.split(np.arange(series.size), np.flatnonzero(series.begins)[1:]):
        x, period_s = series.resolution * series.cell[rows], series.periods_s[series.recording[rows[0]]]
        every = max(round(_STEP_S / period_s), 1)
        steps = np.diff(x[::every])
        way += float(np.maximum(np.abs(steps) - series.resolution, 0.0).sum())  # quantisation is not motion
        square += float(np.maximum(steps**2 - series.resolution**2, 0.0).sum()) / (every * period_s)
        if steps.size:
            energy += 0.5 * inertia * float(steps[0] / (every * period_s)) ** 2
        moved, n = np.diff(x), x.size - 1
        reach = min(LATEST, n - 1)  # a stretch may be shorter
        for k in range(-reach, reach + 1):
            late, early = max(k, 0), max(-k, 0)
            work[k + LATEST] += torque[rows][early : n - late] @ moved[late : n - early]
    gets = _MOST_WORK * (max(float(work.max()), 0.0) + energy)
    return gets / max(way, series.resolution), gets / max(square, series.resolution**2 / series.duration_s)


def at_the_end(fit: Fit, half: Floats, *, is_held: bool = False) -> list[str]:
    """Doubts: base parameters that the data do not distinguish from an end of their range, except a kept inertia."""
    asked = [slug for slug in BASE_WORDS if not (is_held and slug == "inertia_error")]
    own = [(term, fit.columns(number)) for number, term in enumerate(fit.terms) if term.slug in asked]
    open_ended = [BASE_WORDS[term.slug] for term, columns in own if term.at_bounds(fit.u[columns], half[columns])]
    if not open_ended:
        return []
    return [
        f"These data do not distinguish {' and '.join(open_ended)} from the end of the fitted range. Either the model is of "
        "another device, or the current does not cause the motion, as where a controller makes the current follow "
        "the motion. The named effects depend on that."
    ]
