"""Friction changes as the device warms up: c → c(1 + r(1 − exp(−t/t_w)))."""

from __future__ import annotations

import math

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="thermal_drift",
    summary="Friction changes as the device warms up, from the start of the record on.",
    law="c → c (1 + r (1 − exp(−t / t_w))), t the plant's time",
    parameters=parameters_of("thermal_drift"),
    source="First-order warming; friction over temperature: Bittencourt and Gunnarsson 2012.",
    where_it_shows="A Coulomb residual that grows over the record.",
    near=("coulomb_friction",),
)


@njit("float64(float64, float64, float64)", inline=True)
def warming_factor(time: float, r: float, t_w: float) -> float:
    """Return the factor on the Coulomb friction at a time since the start."""
    return 1.0 - r * math.expm1(-time / t_w)
