"""Play between motor and load: a contact at ±gap/2 that is rigid (inelastic or with a rebound), or a spring and a damper."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from hapticd.effects.parameters import ANGLE, DAMPING, NUMBER, STIFFNESS, load_share, magnitude, small_displacements
from hapticd.effects.spec import Complaint, Effect, Notes, Parameter, Scale, Values

_CONTACT_PERIODS = (6.0, 18.0)
"""Oscillation periods of both masses on their contact, in periods of the record, as start values of a fit."""
_CONTACT_DAMPING = 0.1


def common_velocity(motor_inertia: float, omega: float, load_inertia: float, load_omega: float) -> float:
    """Return the velocity after an inelastic impact."""
    return (motor_inertia * omega + load_inertia * load_omega) / (motor_inertia + load_inertia)


def rebound(stiffness: float, damping: float, reduced_inertia: float) -> float:
    """Return the coefficient of restitution of a contact with a spring and a damper that never pulls."""
    zeta = 0.5 * damping / math.sqrt(stiffness * reduced_inertia)
    square = 1.0 - zeta * zeta
    if abs(square) < 1e-9:
        return math.exp(-2.0)
    root = math.sqrt(abs(square))
    angle = math.atan2(2.0 * zeta * root, 2.0 * zeta * zeta - 1.0) if square > 0.0 else 2.0 * math.log(zeta + root)
    return math.exp(-zeta / root * angle)


def _grid(scale: Scale) -> Iterable[Values]:
    for gap in small_displacements(scale, 2.0):
        for share in (0.25, 0.5):
            yield {"gap": gap, "load_share": share, "restitution": 0.3}
        for periods in _CONTACT_PERIODS:
            reduced, natural = 0.24 * scale.inertia, 2.0 * math.pi / (periods * scale.period_s)
            damping = 2.0 * _CONTACT_DAMPING * reduced * natural
            yield {"gap": gap, "load_share": 0.4, "stiffness": reduced * natural**2, "damping": damping}


def _joint_check(values: Values) -> Iterator[Complaint]:
    is_rigid = values.get("stiffness", math.inf) == math.inf
    if is_rigid and values.get("damping", 0.0) > 0.0:
        yield Complaint("damping", "is for a contact with a stiffness; a rigid contact has a restitution")
    if not is_rigid and values.get("restitution", 0.0) > 0.0:
        yield Complaint("restitution", "is for a rigid contact; a contact with a stiffness has a damping instead")


EFFECT = Effect(
    slug="backlash",
    summary="Play between the motor, which has encoder and friction, and the load.",
    law=(
        "inertia (1 − load_share) J on the motor, load_share J behind a play of total width gap; contact is rigid and "
        "conserves momentum; the two part again at restitution times the speed at which they met, and at 0 move as "
        "one until the load would have to be pulled. With a finite stiffness they are pushed apart by max(0, stiffness x + "
        "damping x′) while one is beyond the gap by x"
    ),
    parameters=(
        magnitude("gap", ANGLE, 10.0),
        load_share(),
        Parameter("restitution", *NUMBER, neutral=0.0, lower=0.0, upper=0.95),
        Parameter("stiffness", *STIFFNESS, neutral=math.inf, lower=1e-9, upper=1e9, scale="log"),
        magnitude("damping", DAMPING, 1e4, required=False),
    ),
    acts_on="memory",
    source="Nordin and Gutman 2002, and the limit of a stiff contact; restitution: Newton 1687.",
    where_it_shows=(
        "After each reversal the shaft has less inertia while it crosses the play, then its velocity jumps; with a "
        "springy contact it oscillates against the load while the contact is closed."
    ),
    example="gap: 0.01",
    notes=Notes(
        told_apart="`presliding` has a restoring force and no jump; `flexible_coupling` rings and returns.",
        shown_by="reversals of different size and speed, faster than friction brakes the load.",
        simulated=(
            "Contacts, stops and separations are located; between them the motion is in closed form. In the tests the rigid "
            "contact is within 1 % of a 3 kHz one with twice critical damping, and a springy one within 2·10⁻³. A springy "
            "contact never pulls: it opens when its force is zero. With damping ratio ζ its restitution is about "
            "exp(−ζ(π − 2ζ)), and if motor and load would oscillate on it faster than 10 kHz it is the rigid one with that "
            "restitution. "
            "A rigid contact fitted to one of 1.5 kHz with ζ = 0.3 has errors of some 7 % in gap and load's share."
        ),
    ),
    grid=_grid,
    joint_check=_joint_check,
    accuracy=7e-2,  # errors of gap and share if a rigid contact is fitted to an elastic one
    near=("presliding", "flexible_coupling"),
    contains=("inertia_error",),
    excludes=("flexible_coupling",),
)
