"""The LuGre bristle: friction is elastic before it slides."""

from __future__ import annotations

import math

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="presliding",
    summary=("Friction is elastic before it slides: the shaft creeps and springs back (LuGre); it replaces stiction."),
    law=(
        "ż = ω − |ω| z sigma_0 / c, torque −(sigma_0 z + sigma_1 ż), sigma_0 = c / breakaway, c with its "
        "Stribeck and load terms in ż"
    ),
    parameters=parameters_of("presliding"),
    source="Canudas de Wit, Olsson, Åström and Lischinsky 1995.",
    where_it_shows=(
        "Small motion where the model sticks, hysteresis over position after every reversal; friction comes "
        "back over a distance, not at once."
    ),
    near=("backlash", "stribeck"),
)


@njit("float64(float64, float64, float64)", inline=True)
def bristle_after(z: float, steady: float, way: float) -> float:
    """Return the deflection after a way in one direction: over the way the law is linear, whatever the speed.

    Args:
        z: deflection before [rad or m].
        steady: deflection in steady sliding, with the sign of the direction.
        way: distance covered, ≥ 0.
    """
    return steady + (z - steady) * math.exp(-way / abs(steady))
