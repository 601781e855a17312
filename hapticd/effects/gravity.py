"""A weight on an arm: −m g l sin(θ − θ₀)."""

from __future__ import annotations

from hapticd.effects.parameters import TORQUE, magnitude, phases, shift
from hapticd.effects.spec import Effect, Notes


def torque(sine: float, m_g_l: float) -> float:
    """Return the torque for the sine of the angle from the rest position, or for the mean of that sine over a path."""
    return -m_g_l * sine


EFFECT = Effect(
    slug="gravity",
    summary="A weight on an arm, or an unbalanced handle; hanging at rest at θ₀.",
    law="−m_g_l sin(θ − theta_0); on a linear device θ is the position in m, read as rad",
    parameters=(magnitude("m_g_l", TORQUE, 1e4), shift("theta_0")),
    acts_on="force",
    rotary_only=True,
    source="Statics of a pendulum.",
    where_it_shows=(
        "A residual torque that is a sine of the position, one period per revolution, largest a quarter turn from rest."
    ),
    example="m_g_l: 3.0e-3",
    notes=Notes(
        told_apart=(
            "In small motion it is a `constant_bias` (far from rest) or a `return_spring` (near it); in whole turns "
            "it is a `torque_ripple` of order 1. `encoder_eccentricity` has the same period but grows with the square of "
            "the speed."
        ),
        shown_by="slow motion over at least half a turn, both ways.",
        simulated=(
            "Second order in the substep; stops and breakaway are located (2·10⁻³ of the distance or better in the tests)."
        ),
    ),
    amplitude="m_g_l",
    grid=lambda scale: [{"m_g_l": 0.05 * scale.torque, "theta_0": theta_0} for theta_0 in phases(8)],
    accuracy=1e-3,
    near=("constant_bias", "return_spring", "torque_ripple", "encoder_eccentricity"),
    contains=("constant_bias", "return_spring"),
    stiffness=lambda values: float(values["m_g_l"]),
)
