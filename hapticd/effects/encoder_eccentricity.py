"""The encoder's disc is off centre: the measured angle is θ + e sin(θ + φ)."""

from __future__ import annotations

import math

from hapticd.effects.parameters import ANGLE, magnitude, phase, phases
from hapticd.effects.spec import Effect, Notes


def measured(theta: float, e: float, phi: float) -> float:
    """Return what the encoder sees of the true angle."""
    return theta + e * math.sin(theta + phi) if e != 0.0 else theta


EFFECT = Effect(
    slug="encoder_eccentricity",
    summary="The encoder's disc or tape is off centre.",
    law="measured θ + e sin(θ + phi); on a linear device θ is the position in m, read as rad",
    parameters=(magnitude("e", ANGLE, 0.9), phase()),
    acts_on="measurement",
    rotary_only=True,
    source="Disc eccentricity: error of one period a revolution (Heidenhain, Rotary Encoders).",
    where_it_shows=(
        "Measured speed is modulated once a revolution in proportion to speed, which looks like a torque ∝ ω² cos."
    ),
    example="e: 0.01",
    notes=Notes(
        in_data=(
            "At constant speed the measured speed is modulated once a revolution in proportion to speed, and the apparent "
            "torque with its square."
        ),
        told_apart="`gravity` and `torque_ripple` of order 1 do not depend on speed.",
        shown_by="whole turns at two speeds.",
        simulated="Closed form.",
    ),
    amplitude="e",
    grid=lambda scale: [{"e": 5.0 * scale.resolution, "phi": phi} for phi in phases(8)],
    near=("gravity", "torque_ripple"),
)
