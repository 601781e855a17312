"""Coulomb friction that differs between the directions: c± = c(1 ± a)."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="asymmetric_coulomb",
    summary="Coulomb friction differs between the two directions.",
    law="torque −c sgn(ω) − a c",
    parameters=parameters_of("asymmetric_coulomb"),
    source="Armstrong-Hélouvry, Dupont and Canudas de Wit 1994.",
    where_it_shows=(
        "A residual torque that is the same in both directions; no data can tell it from a constant bias of −a c."
    ),
    equivalent_to=("constant_bias",),
    exact=True,
)


@njit("float64(float64, float64)", inline=True)
def asymmetry_torque(coulomb: float, a: float) -> float:
    """Return the constant torque −a c that the asymmetry amounts to."""
    return -a * coulomb
