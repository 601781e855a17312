"""Explanations that the data at hand cannot tell apart, each as a device that can be simulated and fitted again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hapticd.config import Config, ConfigError, parse_config
from hapticd.gap.hypothesis import Hypothesis
from hapticd.gap.model_file import add_effect

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.search import Judged

    Floats = NDArray[np.float64]

HAND = "hand_impedance"


@dataclass(frozen=True)
class Rival:
    """One explanation, as the data at hand fit it."""

    slug: str
    """The effect that makes the difference to its rivals."""
    hypothesis: Hypothesis
    u: Floats
    """Fitted coordinates."""
    config: Config
    """The model with all its effects."""


def rival(model: Config, judged: Judged, final: Judged, slug: str) -> Rival | None:
    """An explanation from the round in which it competed.

    Args:
        model: the nominal model.
        judged: the explanation.
        final: the last model of the search, whose effects after that one are taken over.
        slug: the effect that it stands for.

    Returns:
        None where it cannot be simulated in an experiment to come: which commands get lost cannot be known beforehand,
        and a fitted parameter may lie where no config may.
    """
    hypothesis, u = judged.hypothesis, judged.fit.solution.u
    count = len(hypothesis.terms)
    before = sum(len(term.coordinates) for term in final.hypothesis.terms[:count])
    for term in final.hypothesis.terms[count:]:
        hypothesis = hypothesis.with_term(term)
    u = np.concatenate([u, final.fit.solution.u[before:]])
    hypothesis, u = _let_go(hypothesis, u)
    if any(term.lost for term in hypothesis.terms):
        return None
    try:
        return Rival(slug, hypothesis, u, _config(model, hypothesis, u))
    except ConfigError:
        return None


def _let_go(hypothesis: Hypothesis, u: Floats) -> tuple[Hypothesis, Floats]:
    """Without the grip of a hand: in an experiment to come nobody holds the handle."""
    for number, term in enumerate(hypothesis.terms):
        if term.slug == HAND:
            first = sum(len(other.coordinates) for other in hypothesis.terms[:number])
            return hypothesis.without(number), np.delete(u, np.s_[first : first + len(term.coordinates)])
    return hypothesis, u


def _config(model: Config, hypothesis: Hypothesis, u: Floats) -> Config:
    data = model.model_dump()
    for number, term in enumerate(hypothesis.terms):
        share = hypothesis.share(u, number)
        add_effect(data, term.slug, term.entry(share) if term.entry else term.parameters(share))
    return parse_config(data, f"the model with {' and '.join(hypothesis.slugs)}")


def pairs(rivals: Sequence[Rival]) -> list[tuple[Rival, Rival]]:
    """(what is true, what else is claimed): the first rival against each other one, and the other way round."""
    first, *others = rivals
    return [pair for other in others for pair in ((first, other), (other, first))]
