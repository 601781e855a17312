"""Friction that grows with the load: c → c + κ|K_t i|."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="load_dependent_friction",
    summary="Friction grows with the torque that a bearing or gear carries.",
    law="c → c + kappa |K_t i|",
    parameters=parameters_of("load_dependent_friction"),
    source="Bearing friction proportional to load (SKF, Harris 2001); gear meshes likewise.",
    where_it_shows=(
        "Friction is larger in ticks of large current; torque in motion is smaller than K_t i by a constant share."
    ),
    near=("torque_constant_error", "coulomb_friction"),
    exact=True,
)


@njit("float64(float64, float64)", inline=True)
def load_friction(kappa: float, torque: float) -> float:
    """Return the Coulomb friction that the motor's torque adds."""
    return kappa * abs(torque)
