"""Drag that grows with the square of the speed: −d ω|ω|."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="quadratic_drag",
    summary="Drag quadratic in speed; with d < 0 friction that grows less than linearly.",
    law="−d ω|ω|, and for d < 0 no more than the rest of the friction: friction never pushes",
    parameters=parameters_of("quadratic_drag"),
    source="Windage and lubricant churning; friction of greased gears is often degressive.",
    where_it_shows="A residual torque curved over speed, odd in it.",
    near=("stribeck", "viscous_friction"),
)


@njit("float64(float64, float64, float64)", inline=True)
def degressive_relief(speed: float, d: float, friction: float) -> float:
    """Return by how much d < 0 lowers the rest of the friction: |d| speed², and never more than there is."""
    return min(-d * speed * speed, friction)
