"""The inertia differs from the model's: J → J(1 + r)."""

from __future__ import annotations

from hapticd.effects.parameters import corrected, relative
from hapticd.effects.spec import Effect, Notes

EFFECT = Effect(
    slug="inertia_error",
    summary="The device's inertia differs from the model's.",
    law="J → J (1 + r)",
    parameters=(relative("r", -0.8, 4.0),),
    acts_on="base",
    source="Eq. 1; inertias on data sheets leave out shaft, coupling and handle.",
    where_it_shows=(
        "The acceleration after every change of force is wrong by one factor, in both directions and at all speeds; "
        "steady motion is right."
    ),
    example="r: 0.2",
    notes=Notes(
        told_apart=(
            "`torque_constant_error` scales the torque, and so also the current at which the shaft breaks away; "
            "`inertia_error` does not change that. Without friction the two are the same; J, b and c wrong by one common "
            "factor are always the same as K_t wrong by its inverse."
        ),
        shown_by="steps or a chirp well above the friction, and slow ramps through breakaway.",
        simulated="Closed form.",
    ),
    amplitude="r",
    grid=lambda scale: [{"r": 0.05}],
    near=("torque_constant_error",),
    in_loop=lambda loop, values: {"inertia": corrected(loop.inertia, values["r"])},
)
