"""The encoder's disc is off centre: the measured angle is θ + e sin(θ + φ)."""

from __future__ import annotations

import math

from hapticd.effects.parameters import ANGLE, magnitude, phase, phases
from hapticd.effects.spec import Effect, Notes


def measured(theta: float, e: float, phi: float) -> float:
    """Return the measured angle for a true one."""
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
        "At constant speed the measured speed has one period per revolution with an amplitude proportional to speed, like "
        "a torque proportional to its square."
    ),
    example="e: 0.01",
    notes=Notes(
        told_apart="`gravity` and `torque_ripple` of order 1 do not depend on speed.",
        shown_by="whole turns at two speeds.",
        simulated="Closed form.",
    ),
    amplitude="e",
    grid=lambda scale: [{"e": 5.0 * scale.resolution, "phi": phi} for phi in phases(8)],
    near=("gravity", "torque_ripple"),
)
