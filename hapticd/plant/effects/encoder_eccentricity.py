"""The encoder's disc is off centre: the measured angle is θ + e sin(θ + φ)."""

from __future__ import annotations

import math

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="encoder_eccentricity",
    summary="The encoder's disc or tape is off centre.",
    law="measured θ + e sin(θ + phi); on a linear device θ is the position in m, read as rad",
    parameters=parameters_of("encoder_eccentricity"),
    source="Disc eccentricity: error of one period a revolution (Heidenhain, Rotary Encoders).",
    where_it_shows=(
        "Measured speed is modulated once a revolution in proportion to speed, which looks like a torque ∝ ω² cos."
    ),
    near=("gravity", "torque_ripple"),
    exact=True,
)


@njit("float64(float64, float64, float64)", inline=True)
def measured_angle(theta: float, e: float, phi: float) -> float:
    """Return what the encoder sees of the true angle."""
    return theta + e * math.sin(theta + phi) if e != 0.0 else theta
