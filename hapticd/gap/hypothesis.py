"""A hypothesis: the nominal device plus a list of effects, as a point in a box of real coordinates.

A term says which words of the device vector its coordinates write, and what the coordinates mean in the parameters of the
catalogue. Coordinates are chosen so that predictions depend on them as evenly as possible: phases as sine and cosine
amplitudes, times and frequencies as logarithms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.plant.layout import word

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]

_BREAKAWAY, _PLAY, _RESONANCE = word("presliding.breakaway"), word("backlash.gap"), word("flexible_coupling.f_r")


def has_memory(vector: Floats) -> bool:
    """Whether a device remembers more than its position and velocity: a bristle, or a load of its own."""
    return bool(vector[_BREAKAWAY] > 0.0 or vector[_PLAY] > 0.0 or np.isfinite(vector[_RESONANCE]))


@dataclass(frozen=True)
class Coordinate:
    """One number that is fitted."""

    name: str
    lower: float
    upper: float
    step: float
    """First difference step; adapted while fitting."""


@dataclass(frozen=True)
class Device:
    """What is simulated: the words of the device and, for each tick, whether its command was lost."""

    vector: Floats
    lost: NDArray[np.uint8] | None = None
    grips: tuple[tuple[float, float], ...] | None = None
    """Intervals [s] of a grip; the vector itself has room for one."""


@dataclass(frozen=True)
class Term:
    """An effect in a form that can be fitted."""

    slug: str
    coordinates: tuple[Coordinate, ...]
    write: Callable[[Floats, Floats], None]
    """write(vector, u): put the effect at coordinates u into a device vector."""
    parameters: Callable[[Floats], Mapping[str, float]]
    """Parameters of the catalogue at coordinates u, one entry a number: `order_2`, `amplitude_2`, …"""
    start: tuple[float, ...]
    trials: float = 1.0
    """How many independent things were tried to find this form: it raises the bar for evidence."""
    lost: tuple[NDArray[np.uint8], ...] = ()
    """Lost commands (n,) of each recording, for the one effect that has them as latent variables."""
    prices: tuple[Floats, ...] = ()
    """What the freedom to choose each tick's fate costs, (n,) of each recording, in units of the loss."""
    grips: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Intervals of a grip in each recording, for the one effect that comes and goes."""
    entry: Callable[[Floats], Mapping[str, object]] | None = None
    """The effect as an entry of `plant.effects`; None where `parameters` is already that."""
    is_rugged: bool = False
    """Whether the loss has many small minima: impacts come or stay away with the least change."""
    scatter: Floats | None = None
    """Covariance (p, p) of the minima that fit as well, where the loss is rugged and the fit can tell one only."""
    form: Mapping[str, object] = field(default_factory=dict)
    """Discrete choices made before the fit (orders, intervals), for reports."""


def _written(term: Term, share: Floats) -> Callable[[Floats, Floats], None]:
    """What puts a term at fixed coordinates into a device vector."""

    def write(vector: Floats, u: Floats) -> None:
        del u
        term.write(vector, share)

    return write


@dataclass(frozen=True)
class Hypothesis:
    """The base device with terms; coordinates of all terms in one vector, in order."""

    base: Floats
    terms: tuple[Term, ...] = ()

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """Coordinates of all terms, in order."""
        return tuple(c for term in self.terms for c in term.coordinates)

    @property
    def slugs(self) -> tuple[str, ...]:
        """Slugs of the terms, in order."""
        return tuple(term.slug for term in self.terms)

    @property
    def is_rugged(self) -> bool:
        """Whether one of the terms is."""
        return any(term.is_rugged for term in self.terms)

    def share(self, u: Floats, term: int) -> Floats:
        """The part of `u` that belongs to one term."""
        first = sum(len(t.coordinates) for t in self.terms[:term])
        return u[first : first + len(self.terms[term].coordinates)]

    def start(self) -> Floats:
        """Start values of all terms."""
        return np.array([value for term in self.terms for value in term.start], dtype=np.float64)

    def device(self, u: Floats, segment: int) -> Device:
        """The device at coordinates u, for one recording."""
        vector = self.base.copy()
        lost, grips = None, None
        for number, term in enumerate(self.terms):
            term.write(vector, self.share(u, number))
            if term.lost:
                lost = term.lost[segment]
            if term.grips:
                grips = term.grips[segment]
        return Device(vector, lost, grips)

    def has_memory(self, u: Floats, segment: int) -> bool:
        """Whether the device remembers more than its position and velocity."""
        return has_memory(self.device(u, segment).vector)

    def latent_loss(self, segment: int, windows: Segment) -> Floats | float:
        """What the freedom to choose the lost commands costs each window."""
        for term in self.terms:
            if term.prices:
                return windows.per_window(term.prices[segment])
        return 0.0

    def with_term(self, term: Term) -> Hypothesis:
        """This hypothesis and one more effect."""
        return Hypothesis(self.base, (*self.terms, term))

    def without(self, term: int) -> Hypothesis:
        """This hypothesis without one of its effects."""
        return Hypothesis(self.base, self.terms[:term] + self.terms[term + 1 :])

    def held(self, u: Floats, terms: int) -> Hypothesis:
        """This hypothesis with its first terms held where `u` has them: they have no coordinates any more."""
        held = [
            replace(term, coordinates=(), start=(), write=_written(term, self.share(u, number)))
            for number, term in enumerate(self.terms[:terms])
        ]
        return Hypothesis(self.base, (*held, *self.terms[terms:]))

    def steps(self, u: Floats) -> Floats:
        """First difference steps."""
        return np.array([c.step for c in self.coordinates])

    def largest_step(self, k: int) -> float:
        """Largest sensible difference step of a coordinate: a quarter of its range."""
        c = self.coordinates[k]
        return 0.25 * (c.upper - c.lower)

    def bounded(self, u: Floats) -> Floats:
        """Nearest point inside the box."""
        if not len(u):
            return u
        return np.clip(u, [c.lower for c in self.coordinates], [c.upper for c in self.coordinates])

    def nudged(self, u: Floats, k: int, step: float) -> tuple[Floats, float]:
        """`u` with coordinate k moved by about `step`, inwards where the box ends, and the step really made."""
        c = self.coordinates[k]
        moved = u.copy()
        if u[k] + step > c.upper:
            step = -step
        moved[k] = np.clip(u[k] + step, c.lower, c.upper)
        return moved, float(moved[k] - u[k])
