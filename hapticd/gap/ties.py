"""Which effects these data cannot tell apart.

Two effects are tied when neither predicts held-out windows better than chance would: whatever a table of near-ties says,
the data at hand decide. Effects of one exact class (the same law in other parameters) are tied on any data, and naming one
of them names all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hapticd.plant.effects.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hapticd.gap.search import Data, Judged

RESOLVED = 3.0
"""Standard errors by which a rival must be behind to be ruled out: one in a thousand."""


def exact_class(slug: str) -> tuple[str, ...]:
    """Effects with the very same law, `slug` itself not among them."""
    return CATALOGUE[slug].equivalent_to


def rivals(winner: str, round_of: Mapping[str, Judged], data: Data) -> list[str]:
    """Candidates of a round that are not ruled out against its winner, best first."""
    best = round_of[winner]
    tied = []
    for slug, judged in round_of.items():
        if slug != winner and best.against(judged, data).z < RESOLVED:
            tied.append(slug)
    return sorted(tied, key=lambda slug: float(round_of[slug].held_out.loss.sum()))


def across_classes(winner: str, tied: list[str]) -> list[str]:
    """Those of the tied effects that are another law than the winner."""
    return [slug for slug in tied if slug not in exact_class(winner)]
