"""A weight on an arm: −m g l sin(θ − θ₀)."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.path_mean import mean_sine
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="gravity",
    summary="A weight on an arm, or an unbalanced handle; hanging at rest at θ₀.",
    law="−m_g_l sin(θ − theta_0); on a linear device θ is the position in m, read as rad",
    parameters=parameters_of("gravity"),
    source="Statics of a pendulum.",
    where_it_shows="A residual torque that is a sine of the position, one period a revolution.",
    near=("constant_bias", "return_spring", "torque_ripple", "encoder_eccentricity"),
)


@njit("float64(float64, float64, float64)", inline=True)
def gravity_torque(angle: float, half_way: float, m_g_l: float) -> float:
    """Return the torque averaged over the angles `angle` ± `half_way` from the rest position."""
    return -m_g_l * mean_sine(angle, half_way)
