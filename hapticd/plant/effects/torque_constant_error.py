"""The torque constant is not the model's: K_t → K_t(1 + r)."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="torque_constant_error",
    summary="The motor gives more or less torque per ampere than the model says.",
    law="K_t → K_t (1 + r)",
    parameters=parameters_of("torque_constant_error"),
    source="Winding tolerance and magnet temperature, ±10 % on most motor data sheets.",
    where_it_shows="A residual torque proportional to the current, also at rest.",
    near=("inertia_error",),
    exact=True,
)
