"""Friction that falls with speed: c → c(1 + s exp(−(ω/ω_s)²))."""

from __future__ import annotations

import math

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="stribeck",
    summary="Friction is larger near standstill than in motion.",
    law="c → c (1 + s exp(−(ω/omega_s)²))",
    parameters=parameters_of("stribeck"),
    source="Armstrong-Hélouvry, Dupont and Canudas de Wit 1994 (Gaussian form).",
    where_it_shows="Too much friction just before and after every stop; breakaway at c (1 + s), then a jump.",
    near=("quadratic_drag", "presliding", "coulomb_friction"),
)


@njit("float64(float64, float64, float64)", inline=True)
def stribeck_factor(speed: float, s: float, omega_s: float) -> float:
    """Return the factor on the Coulomb friction."""
    ratio = speed / omega_s
    return 1.0 + s * math.exp(-ratio * ratio)
