"""Viscous friction that differs between the directions: b± = b(1 ± a)."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="asymmetric_viscous",
    summary="Viscous friction differs between the two directions.",
    law="b → b (1 + a sgn(ω))",
    parameters=parameters_of("asymmetric_viscous"),
    source="Janot, Gautier and Brunot 2019 (EMPS).",
    where_it_shows="A residual torque −a b |ω|, the same in both directions, that grows with speed.",
    near=("constant_bias",),
)


@njit("float64(float64, float64, float64)", inline=True)
def directed_viscous(viscous: float, a: float, direction: float) -> float:
    """Return the viscous friction of one direction (±1)."""
    return viscous * (1.0 + a * direction)
