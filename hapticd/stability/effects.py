"""What the theory can take of a plant's effects, and what it leaves to simulation.

The criterion needs the least friction and the longest delay that the device ever has, so an effect that varies is counted
at its worst, as its file in the catalogue says (`Effect.in_loop`). `hapticd.stability.numbers` puts that into the loop; what
cannot be put into μ, β, σ, τ_D and κ is named here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hapticd.effects.catalogue import CATALOGUE

if TYPE_CHECKING:
    from hapticd.config import Config


def uncounted(config: Config) -> tuple[str, ...]:
    """Effects of the plant that the theory leaves out."""
    return tuple(listed.name for listed in config.plant.effects if CATALOGUE[listed.name].in_loop is None)
