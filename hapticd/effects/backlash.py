"""Play between motor and load: rigid contact at ±gap/2, inelastic or with a rebound."""

from __future__ import annotations

from collections.abc import Iterable

from hapticd.effects.parameters import ANGLE, NUMBER, load_share, magnitude, small_ways
from hapticd.effects.spec import Effect, Notes, Parameter, Scale, Values


def common_velocity(motor_inertia: float, omega: float, load_inertia: float, load_omega: float) -> float:
    """Return the velocity after an inelastic impact."""
    return (motor_inertia * omega + load_inertia * load_omega) / (motor_inertia + load_inertia)


def _grid(scale: Scale) -> Iterable[Values]:
    return [
        {"gap": gap, "load_share": share, "restitution": 0.3} for gap in small_ways(scale, 2.0) for share in (0.25, 0.5)
    ]


EFFECT = Effect(
    slug="backlash",
    summary="Play between the motor, which has encoder and friction, and the load.",
    law=(
        "inertia (1 − load_share) J on the motor, load_share J behind a play of total width gap; contact is rigid and "
        "keeps the momentum; the two part again at restitution times the speed at which they met, and at 0 move as "
        "one until the load would have to be pulled"
    ),
    parameters=(
        magnitude("gap", ANGLE, 10.0),
        load_share(),
        Parameter("restitution", *NUMBER, neutral=0.0, lower=0.0, upper=0.95),
    ),
    acts_on="memory",
    source="Nordin and Gutman 2002, the limit of a stiff contact; restitution: Newton 1687.",
    where_it_shows=(
        "After a reversal the shaft accelerates as if it were lighter, then a jump of the velocity at contact."
    ),
    example="gap: 0.01",
    notes=Notes(
        in_data=(
            "After each reversal the shaft is lighter for the time it takes to cross the play, then its velocity jumps."
        ),
        told_apart="`presliding` has a restoring force and no jump; `flexible_coupling` rings and returns.",
        shown_by="reversals of different size and speed, faster than friction brakes the load.",
        simulated=(
            "Contacts, stops and partings are located; between them the motion is in closed form. The tests hold it to 1 "
            "% of a 3 kHz contact with twice critical damping. A stiff contact of damping ratio ζ rebounds with about "
            "exp(−πζ/√(1 − ζ²)); fitted to one with ζ of 0.3, the gap and the load's share come out some 7 % off."
        ),
    ),
    grid=_grid,
    accuracy=7e-2,  # a contact that gives shows as a rigid one whose gap and share are so much off
    near=("presliding", "flexible_coupling"),
    contains=("inertia_error",),
    excludes=("flexible_coupling",),
)
