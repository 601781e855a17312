"""The viscous friction differs from the model's: b → b(1 + r)."""

from __future__ import annotations

from hapticd.effects.parameters import corrected, relative
from hapticd.effects.spec import Effect, Notes

EFFECT = Effect(
    slug="viscous_friction",
    summary="The viscous friction differs from the model's.",
    law="b → b (1 + r)",
    parameters=(relative("r", -1.0, 20.0),),
    acts_on="base",
    source="Eq. 1.",
    where_it_shows=(
        "A residual torque proportional to velocity: constant-current runs settle at another speed, or decay at another "
        "rate."
    ),
    example="r: 3",
    notes=Notes(
        told_apart=(
            "`quadratic_drag` is curved over speed; `asymmetric_viscous` differs between the directions. One speed alone "
            "distinguishes none of them."
        ),
        shown_by="steady motion at several speeds in both directions.",
        simulated="Closed form.",
    ),
    amplitude="r",
    reach=lambda scale: scale.torque / (scale.viscous * scale.speeds[-1]),
    grid=lambda scale: [{"r": 0.05}],
    near=("quadratic_drag", "asymmetric_viscous"),
    in_loop=lambda loop, values: {"viscous": corrected(loop.viscous, values["r"])},
)
