"""The torque constant differs from the model's: K_t → K_t(1 + r)."""

from __future__ import annotations

from hapticd.effects.parameters import corrected, relative
from hapticd.effects.spec import Effect, Notes

EFFECT = Effect(
    slug="torque_constant_error",
    summary="The motor gives more or less torque per ampere than the model says.",
    law="K_t → K_t (1 + r)",
    parameters=(relative("r", -0.8, 4.0),),
    acts_on="base",
    source="Winding tolerance and magnet temperature, ±10 % on most motor data sheets.",
    where_it_shows="A residual torque proportional to K_t i, in motion and at breakaway.",
    example="r: -0.1",
    notes=Notes(
        told_apart=(
            "`inertia_error` does not change breakaway; `load_dependent_friction` changes sign between driving and "
            "braking; `current_saturation` shows at large currents only."
        ),
        shown_by="ramps through breakaway and steps, both ways.",
        in_theory="The virtual spring is stiffer by the same factor.",
        simulated="Closed form.",
    ),
    amplitude="r",
    grid=lambda scale: [{"r": 0.05}],
    near=("inertia_error",),
    in_loop=lambda loop, values: {
        "stiffness": corrected(loop.stiffness, values["r"]),
        "damping": corrected(loop.damping, values["r"]),
        "force_error": corrected(loop.force_error, values["r"]),
    },
)
