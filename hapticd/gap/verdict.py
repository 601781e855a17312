"""From numbers to one of four answers, and the sentence that says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.result import Verdict

GOOD_ENOUGH = 1.2
"""Held-out gap up to which a model is as good as the data allow."""
_TOLD = 2
_STILL_THERE = 1.1
"""A gap that falls below this without its worst windows is the doing of these few."""


@dataclass(frozen=True)
class Remaining:
    """What is left of the gap after the last effect."""

    gap: float
    trimmed: float
    """The gap without its worst few windows (`evidence.few_windows`)."""
    many_far_off: bool
    """Whether some windows are further off than slips which went the other way by chance can explain."""
    structure: tuple[str, ...]
    """Coordinates that the residual still depends on, if that is too much to be left alone."""

    @property
    def too_large(self) -> bool:
        """Whether predictions are worse than noise alone makes them, and more than a marginal slip or two can do."""
        return self.gap > GOOD_ENOUGH and (self.trimmed > _STILL_THERE or self.many_far_off)

    @property
    def unexplained(self) -> bool:
        """Whether something is missing that the model has no name for."""
        return self.too_large or bool(self.structure)

    @property
    def words(self) -> str:
        """Why it is unexplained."""
        worse = f"predictions are still {self.gap:.2f} times worse than noise allows"
        if not self.structure:
            return worse
        depends = f"what is left is no noise, it depends on {' and on '.join(self.structure[:_TOLD])}"
        return f"{worse}, and {depends}" if self.too_large else f"{depends} (gap {self.gap:.2f})"


def decide(effects: Sequence[str], tied: Sequence[Sequence[str]], remaining: Remaining) -> tuple[Verdict, str]:
    """Verdict and statement.

    Args:
        effects: slugs that were added.
        tied: for each, the effects of other classes that these data cannot tell from it.
        remaining: what is left.
    """
    names = " and ".join(effects)
    if remaining.unexplained:
        if effects:
            some = f"{names} improve{'s' if len(effects) == 1 else ''} the model, but {remaining.words}"
            return "unexplained", f"{some}: something is missing that has no name here."
        return "unexplained", f"No effect of the catalogue explains the gap: {remaining.words}."
    if not effects:
        gap = f"gap {remaining.gap:.2f}"
        if remaining.gap > GOOD_ENOUGH:
            gap += f", {remaining.trimmed:.2f} without its few worst windows, which decide nothing by themselves"
        return "no_missing_effect", f"Nothing is missing: the model predicts as well as the data allow ({gap})."
    ambiguous = [(effect, others) for effect, others in zip(effects, tied, strict=True) if others]
    if ambiguous:
        told = "; ".join(f"{effect} or {' or '.join(others)}" for effect, others in ambiguous)
        return "ambiguous", f"These data cannot tell which it is: {told}."
    return "effect_found", f"Missing: {names} (gap {remaining.gap:.2f} with {'it' if len(effects) == 1 else 'them'})."
