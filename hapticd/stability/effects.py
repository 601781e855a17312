"""What the theory can take of a plant's effects: errors of base parameters, delays, a spring; the weaker side of friction.

The criterion needs the least friction and the longest delay that the device ever has, so an effect that varies is counted
at its worst, as its file in the catalogue says. What cannot be put into μ, β, σ, τ_D and κ is left to simulation, and
`uncounted` names it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from hapticd.effects.catalogue import CATALOGUE

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.stability.numbers import Loop


def with_effects(loop: Loop, config: Config) -> Loop:
    """The loop with what the theory can take of ``plant.effects``."""
    for listed in config.plant.effects:
        effect = CATALOGUE[listed.name]
        if effect.in_loop is not None:
            loop = replace(loop, **effect.in_loop(loop, effect.complete(listed.model_extra or {})))
    return loop


def uncounted(config: Config) -> tuple[str, ...]:
    """Effects of the plant that the theory leaves out."""
    return tuple(listed.name for listed in config.plant.effects if CATALOGUE[listed.name].in_loop is None)
