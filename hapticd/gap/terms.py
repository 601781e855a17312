"""A hypothesis as a vector: the free elements of the device vector, their coordinates and bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hapticd.gap.arrays import Floats
    from hapticd.gap.series import Series


BASE_WORDS = {"inertia_error": "inertia", "viscous_friction": "viscous", "coulomb_friction": "coulomb"}
"""Law of a wrong base parameter to that parameter; the coordinate is its logarithm, with a prior around the given value."""
LINE = "line"
"""Slug of the spectral lines, which are not a law: sinusoidal torques at fixed frequencies (`hapticd.gap.lines`)."""
RECORD_FILTER = "time constant of the record"
"""Coordinate that is not in the device: a filter between the current and its record (`hapticd.gap.late_record`)."""
_INSTANT_S = 0.2
"""Scale of an instant [s]."""
_FAR = 30.0
"""Range of a position parameter around its start, in scales."""
_REACH = 30.0
"""Factor by which a fit may leave its start; the starts are closer to each other. An amplitude has one start and no upper
bound, since its direction gives its value."""


@dataclass(frozen=True)
class Coordinate:
    """One free parameter: an element of the device vector, or its logarithm.

    Attributes:
        name: parameter, with its index if it is an element of a list.
        word: index in the device vector; −1 if it is not in it.
        is_log: whether the coordinate is the logarithm.
        lower, upper: bounds of the coordinate.
        scale: a change of the coordinate that has a visible effect.
        prior: standard deviation of a normal prior about `centre`; infinite for none.
        centre: mean of that prior.
        neutral: value at which an optional part of the law is absent (the rebound of a backlash). It is an end of the
            range, but the law is still the same law there.
    """

    name: str
    word: int
    is_log: bool
    lower: float
    upper: float
    scale: float
    prior: float = np.inf
    centre: float = 0.0
    neutral: float = np.nan


@dataclass(frozen=True)
class Term:
    """One effect of a hypothesis.

    Attributes:
        slug: the effect.
        coordinates: its free parameters.
        start: (k,) their start values.
        fixed: elements that are chosen and not fitted (orders of a ripple), and their values; for lines, −1 minus the number
            of the recording, and the frequency [Hz].
    """

    slug: str
    coordinates: tuple[Coordinate, ...]
    start: tuple[float, ...]
    fixed: tuple[tuple[int, float], ...] = ()

    @property
    def is_signed(self) -> bool:
        """Whether the parameter in which the law is linear may be negative."""
        first = self.coordinates[0]
        return self.slug in BASE_WORDS or not (first.is_log or first.lower >= 0.0)

    def put(self, p: Floats, u: Sequence[float] | Floats) -> None:
        """Write the effect with coordinates `u` into a device vector."""
        for index, value in self.fixed:
            if index >= 0:
                p[index] = value
        for coordinate, value in zip(self.coordinates, u, strict=True):
            if coordinate.word >= 0:
                p[coordinate.word] = np.exp(value) if coordinate.is_log else value

    def at_bounds(self, u: Sequence[float] | Floats, half: Sequence[float] | Floats | float = 0.0) -> list[str]:
        """Parameters whose coordinates in `u`, ± `half`, reach the end of their range."""
        halves = np.broadcast_to(half, len(self.coordinates))
        return [
            c.name
            for c, value, width in zip(self.coordinates, u, halves, strict=True)
            if (value - width <= c.lower != c.neutral) or (value + width >= c.upper != c.neutral)
        ]

    def moved(self, u: Sequence[float] | Floats) -> Term:
        """The same term with another start."""
        return replace(self, start=tuple(float(value) for value in u))

    def scaled(self, amplitude: str, factor: float) -> Term:
        """The term with the parameter in which it is linear (`amplitude`) times a factor, limited to its bounds."""
        u = list(self.start)
        if self.slug in BASE_WORDS:
            (own,) = self.coordinates
            r = max(factor * math.expm1(u[0] - own.centre), math.expm1(own.lower - own.centre))
            return replace(self, start=(min(own.centre + math.log1p(r), own.upper),))
        for k, coordinate in enumerate(self.coordinates):
            if coordinate.name.partition("[")[0] == amplitude:
                value = u[k] + np.log(factor) if coordinate.is_log else u[k] * factor
                u[k] = float(np.clip(value, coordinate.lower, coordinate.upper))
        return replace(self, start=tuple(u))


def term(
    slug: str,
    values: Mapping[str, float | Sequence[float]],
    held: Sequence[str],
    shift_scale: float,
    slowest: float = 0.0,
) -> Term:
    """An effect with start values.

    Args:
        slug: the effect.
        values: parameter to value, or to values if the parameter is a list; a parameter not in it is fixed and neutral.
        held: parameters in `values` that are not fitted.
        shift_scale: scale of a position, rad or m.
        slowest: least value of a parameter that is a speed, rad/s or m/s.
    """
    coordinates, start, fixed = [], [], []
    for parameter in CATALOGUE[slug].parameters:
        if parameter.name not in values:
            continue
        given = values[parameter.name]
        listed = [float(value) for value in given] if isinstance(given, Sequence) else [float(given)]
        first = index_of(f"{slug}.{parameter.name}")
        for k, value in enumerate(listed):
            if parameter.name in held:
                fixed.append((first + k, value))
                continue
            name = parameter.name if parameter.length == 1 else f"{parameter.name}[{k}]"
            is_log = parameter.scale == "log" and value > 0.0
            if is_log:
                reach = np.inf if parameter.name == CATALOGUE[slug].amplitude else _REACH
                least = max(parameter.lower, slowest) if parameter.unit == "rad/s" else parameter.lower
                value = max(value, least)
                lower = np.log(max(least, value / _REACH))
                upper, scale = np.log(min(parameter.upper, value * reach)), 0.5
                value = float(np.log(value))
            else:
                lower, upper = parameter.lower, parameter.upper
                if parameter.unit == "rad" and parameter.unit_linear == "m":  # a place
                    scale = shift_scale
                    lower, upper = max(lower, value - _FAR * scale), min(upper, value + _FAR * scale)
                elif parameter.unit == "s":  # an instant
                    scale = _INSTANT_S
                elif parameter.unit and value != 0.0 and parameter.unit != "rad":
                    scale = abs(value)
                else:
                    scale = max(abs(value), 0.2 if parameter.unit == "rad" else 0.1)
            bounds = float(lower), float(upper), float(scale)
            neutral = np.nan if is_log else parameter.neutral
            coordinates.append(Coordinate(name, first + k, is_log, *bounds, neutral=neutral))
            start.append(value)
    return Term(slug, tuple(coordinates), tuple(start), tuple(fixed))


def line_torques(item: Term, series: Series) -> Floats:
    """Torque per unit of each coordinate of lines in each period, shape (n, k), read only: a sine and a cosine per line."""
    return series.swings(tuple((-1 - word, frequency) for word, frequency in item.fixed))


def torque_slopes(item: Term, u: Sequence[float] | Floats, x: Floats, series: Series) -> Floats | None:
    """Derivative of a term's torque by its coordinates, shape (n, k); None if it is not a function of position or time only.

    With it, all derivatives of a ripple with many orders cost one pass of the linearised filter, instead of one run of the
    filter each.
    """
    if item.slug == LINE:
        return line_torques(item, series).copy()
    if item.slug != "torque_ripple":
        return None
    found = np.empty((x.size, len(item.coordinates)))
    orders = [value for _, value in item.fixed]
    half = len(orders)
    for k, order in enumerate(orders):
        amplitude, phase = np.exp(u[k]), u[half + k]
        found[:, k] = amplitude * np.sin(order * x + phase)
        found[:, half + k] = amplitude * np.cos(order * x + phase)
    return found


def whole_turns(slug: str, name: str, value: float) -> float:
    """Whole turns [rad] in a parameter that is a phase or angle of a sine; 0 for any other parameter."""
    spec = CATALOGUE[slug]
    parameter = next(p for p in spec.parameters if p.name == name)
    is_angle = parameter.unit == "rad" and (parameter.unit_linear == "rad" or spec.rotary_only)
    return 2.0 * math.pi * round(value / (2.0 * math.pi)) if is_angle else 0.0


def parameters_of_term(item: Term, u: Sequence[float] | Floats) -> dict[str, float | list[float]]:
    """Parameter to value (or values) of an effect whose coordinates are `u`, in the order of the catalogue."""
    if item.slug in BASE_WORDS:
        return {"r": math.expm1(float(u[0]) - item.coordinates[0].centre)}
    p: dict[int, float] = dict(item.fixed)
    for coordinate, value in zip(item.coordinates, u, strict=True):
        p[coordinate.word] = float(np.exp(value)) if coordinate.is_log else float(value)
    found: dict[str, float | list[float]] = {}
    for parameter in CATALOGUE[item.slug].parameters:
        first = index_of(f"{item.slug}.{parameter.name}")
        listed = [p[first + k] for k in range(parameter.length) if first + k in p]
        listed = [value - whole_turns(item.slug, parameter.name, value) for value in listed]
        if listed:
            found[parameter.name] = listed[0] if parameter.length == 1 else listed
    return found
