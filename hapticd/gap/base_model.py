"""The problem that a model and recordings make, and its base parameters: inertia, viscous and Coulomb friction.

They are fitted first, from the model's values and from those of a balance of forces by least squares. What the model says of
one, within its uncertainty, is a law less than another value: which of the two it is, the selection asks as of any law.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from drivers import declared_latency
from hapticd.gap import constants
from hapticd.gap.balance import balance
from hapticd.gap.errors import RecordingError
from hapticd.gap.inertia_range import inertia_range
from hapticd.gap.late_record import LATEST
from hapticd.gap.missing import missing_power
from hapticd.gap.problem import Problem
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
"""Factor by which a base parameter may leave what model and balance say. A shaft heavier than that ignores the current."""
_MOST_WORK = 1.5
"""Work against a friction over what the shaft gets: beyond, friction holds it, and a disturbance moves it."""
_PARTED = 1.25
"""Factor beyond the range of a balance from which an inertia is another one."""
_ACCURACY = 0.03
"""How well a balance knows an inertia at best: its filter and the encoder's steps change it by some per cent."""
_STEP_S = 0.05
"""Steps over which a way is summed [s]."""
NOTHING = 1e-6
"""What a friction that the model has not is instead, over the device's torques: nothing that shows."""


def problem_of(recordings: Sequence[Recording], model: Config) -> Problem:
    """What is fitted.

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
    begun = {name: NOTHING * torque / (speed if name == "viscous" else 1.0) for name in zero}
    for name, size in begun.items():
        vector[index_of(name)] = size
    return Problem(series, vector, torque, model.is_linear, begun)


@dataclass(frozen=True)
class Balanced:
    """What a balance of forces says of the base parameters.

    Attributes:
        values: by law; empty where the shaft hardly moves, or against the current.
        inertia: its range; None where the balance does not know it.
    """

    values: Mapping[str, float]
    inertia: InertiaRange | None = None

    def contradicts(self, fit: Fit) -> bool:
        """Whether a fitted inertia is out of range although the balance leaves less force.

        What is predicted best one step ahead need not be the device: a shaft too heavy, beside a disturbance too large,
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
    """The law that a base parameter has another value, as its logarithm, with a wide prior.

    It may be `FARTHEST` from what model and balance say; frictions at most `most_friction`, or what the model says if that
    is more.

    Args:
        problem: what is fitted. slug: one of `BASE_WORDS`. value: where it starts; as given by default.
        filter_s: time constant of a filter before the record of the current; 0 for none.
        balanced: what a balance of forces says, if it says something. held: the range in which an inertia stays, if any.
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
    neutral = math.nan if slug == "inertia_error" else low  # next to no friction is none
    coordinate = Coordinate("r", index, True, low, high, 0.3, constants.BASE_PRIOR, centre, neutral)
    return Term(slug, (coordinate,), (min(max(begin, low), high),))


def known_terms(problem: Problem, model: Config) -> tuple[Term, ...]:
    """Base parameters of which the model says how well it knows them: fitted within that, which is no law."""
    found = []
    for slug, name in BASE_WORDS.items():
        deviation = float(getattr(model.plant.uncertainty, name))
        if deviation > 0.0 and name not in problem.begun:
            (own,) = (law := base_law(problem, slug)).coordinates
            prior = deviation / float(problem.base[own.word])
            found.append(replace(law, slug=name, coordinates=(replace(own, name=name, prior=prior),)))
    return tuple(found)


def most_friction(problem: Problem, filter_s: float = 0.0) -> tuple[float, float]:
    """Coulomb and viscous friction that each take `_MOST_WORK` times what the shaft gets.

    That is the current's work, of a current that acts up to `LATEST` periods before or after its record where that is more,
    and the energy with which each stretch begins, of a shaft as heavy as it may be.
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
        way += float(np.maximum(np.abs(steps) - series.resolution, 0.0).sum())  # an encoder's noise is no way
        square += float(np.maximum(steps**2 - series.resolution**2, 0.0).sum()) / (every * period_s)
        if steps.size:
            energy += 0.5 * inertia * float(steps[0] / (every * period_s)) ** 2
        moved, n = np.diff(x), x.size - 1
        reach = min(LATEST, n - 1)  # a stretch between two gaps may be shorter
        for k in range(-reach, reach + 1):
            late, early = max(k, 0), max(-k, 0)
            work[k + LATEST] += torque[rows][early : n - late] @ moved[late : n - early]
    gets = _MOST_WORK * (max(float(work.max()), 0.0) + energy)
    return gets / max(way, series.resolution), gets / max(square, series.resolution**2 / series.duration_s)


def at_the_end(fit: Fit, half: Floats, *, is_held: bool = False) -> list[str]:
    """Base parameters that the data do not distinguish from an end of the fitted range; not an inertia that is held."""
    asked = [slug for slug in BASE_WORDS if not (is_held and slug == "inertia_error")]
    own = [(term, fit.columns(number)) for number, term in enumerate(fit.terms) if term.slug in asked]
    open_ended = [BASE_WORDS[term.slug] for term, columns in own if term.at_bounds(fit.u[columns], half[columns])]
    if not open_ended:
        return []
    return [
        f"These data do not distinguish {' and '.join(open_ended)} from the end of the range that is fitted: the model is "
        "of another device, or the motion does not follow from the current, as where a controller makes the current follow "
        "the motion. What is named depends on that."
    ]
