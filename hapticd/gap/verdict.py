"""From numbers to one of four answers, and the sentence that says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.result import Verdict

GOOD_ENOUGH = 1.2
"""Held-out gap up to which a model is as good as the data allow."""
_STILL_THERE = 1.1
"""A gap that falls below this without its worst windows is the doing of these few."""


@dataclass(frozen=True)
class Remaining:
    """What is left of the gap after the last effect."""

    gap: float
    trimmed: float
    """The gap without the worst fiftieth of the windows."""
    structure: Sequence[str]
    """Coordinates that the residual still depends on, if that is too much to be left alone."""

    @property
    def unexplained(self) -> bool:
        """Whether something is missing that the model has no name for."""
        return (self.gap > GOOD_ENOUGH and self.trimmed > _STILL_THERE) or bool(self.structure)


def decide(effects: Sequence[str], tied: Sequence[Sequence[str]], remaining: Remaining) -> tuple[Verdict, str]:
    """Verdict and statement.

    Args:
        effects: slugs that were added.
        tied: for each, the effects of other classes that these data cannot tell from it.
        remaining: what is left.
    """
    names = " and ".join(effects)
    if remaining.unexplained:
        rest = f"predictions are still {remaining.gap:.2f} times worse than noise allows"
        if effects:
            return "unexplained", f"{names} improve the model, but {rest}: something is missing that has no name here."
        return "unexplained", f"No effect of the catalogue explains the gap: {rest}."
    if not effects:
        return (
            "no_missing_effect",
            f"Nothing is missing: the model predicts as well as the data allow (gap {remaining.gap:.2f}).",
        )
    ambiguous = [(effect, others) for effect, others in zip(effects, tied, strict=True) if others]
    if ambiguous:
        told = "; ".join(f"{effect} or {' or '.join(others)}" for effect, others in ambiguous)
        return "ambiguous", f"These data cannot tell which it is: {told}."
    return "effect_found", f"Missing: {names} (gap {remaining.gap:.2f} with {'it' if len(effects) == 1 else 'them'})."
