"""What the catalogue says of an effect."""

from __future__ import annotations

from dataclasses import dataclass

from hapticd.config.effect_parameters import EFFECT_PARAMETERS, Parameter

__all__ = ["EffectSpec", "Parameter", "parameters_of"]


@dataclass(frozen=True)
class EffectSpec:
    """One effect of the catalogue.

    Attributes:
        slug: name in configs and in ``gap.json``.
        summary: what it is, in one sentence.
        law: the formula, in the symbols of the parameters.
        parameters: in the order of the device vector.
        source: where the law comes from.
        where_it_shows: what it does to recorded data.
        equivalent_to: effects with the very same law in other parameters.
        near: effects that only the right experiment tells apart.
        exact: whether it is simulated in closed form, without a step size.
    """

    slug: str
    summary: str
    law: str
    parameters: tuple[Parameter, ...]
    source: str
    where_it_shows: str
    equivalent_to: tuple[str, ...] = ()
    near: tuple[str, ...] = ()
    exact: bool = False


def parameters_of(slug: str) -> tuple[Parameter, ...]:
    """Parameters of an effect, as the config knows them."""
    return EFFECT_PARAMETERS[slug]
