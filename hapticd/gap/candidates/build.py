"""Put a term together from parameters that are words of the device vector, each linear or logarithmic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.hypothesis import Coordinate, Term
from hapticd.plant.layout import word

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.context import Context

    Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Scalar:
    """A parameter that is a coordinate by itself: its start, its range on these data, and its scale."""

    name: str
    start: float
    lower: float
    upper: float
    logarithmic: bool = False

    def coordinate(self, slug: str) -> Coordinate:
        """Its coordinate, inside the bounds of the catalogue as well."""
        known = next(p for p in CATALOGUE[slug].parameters if p.name == self.name)
        lower, upper = max(self.lower, known.lower), min(self.upper, known.upper)
        if self.logarithmic:
            return Coordinate(self.name, float(np.log(lower)), float(np.log(upper)), 1e-2)
        return Coordinate(self.name, lower, upper, 1e-3 * (upper - lower))

    def value(self, u: float) -> float:
        """The parameter at a coordinate."""
        return float(np.exp(u)) if self.logarithmic else float(u)

    def at(self, value: float) -> float:
        """The coordinate at a value of the parameter."""
        return float(np.log(value)) if self.logarithmic else value


def scalar_term(slug: str, *scalars: Scalar, trials: float = 1.0, is_rugged: bool = False) -> Term:
    """A term whose coordinates are parameters of the effect, one to one."""
    words = [word(f"{slug}.{s.name}") for s in scalars]

    def write(vector: Floats, u: Floats) -> None:
        for index, s, value in zip(words, scalars, u, strict=True):
            vector[index] = s.value(value)

    def parameters(u: Floats) -> dict[str, float]:
        return {s.name: s.value(value) for s, value in zip(scalars, u, strict=True)}

    coordinates = tuple(s.coordinate(slug) for s in scalars)
    start = tuple(float(np.clip(s.at(s.start), c.lower, c.upper)) for s, c in zip(scalars, coordinates, strict=True))
    return Term(slug, coordinates, write, parameters, start, trials, is_rugged=is_rugged)


def promising(context: Context, terms: list[Term], count: int = 2) -> list[Term]:
    """The few of many starts from which the whole prediction is best: from afar a fit would not find the way."""
    losses = np.array([context.loss_with(term, np.array(term.start)) for term in terms])
    return [terms[k] for k in np.argsort(losses)[:count]]
