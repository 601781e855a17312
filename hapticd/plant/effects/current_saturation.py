"""The amplifier's current is limited: clip(i, ±i_max)."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="current_saturation",
    summary="The amplifier gives no more than i_max.",
    law="i → clip(i, ±i_max)",
    parameters=parameters_of("current_saturation"),
    source="Current limit of the drive.",
    where_it_shows="Residuals only where the command exceeds i_max, proportional to the excess.",
    near=("torque_constant_error", "load_dependent_friction"),
    exact=True,
)


@njit("float64(float64, float64)", inline=True)
def saturate(current: float, i_max: float) -> float:
    """Return the limited current."""
    return min(max(current, -i_max), i_max)
