"""The viscous friction is not the model's: b → b(1 + r)."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="viscous_friction",
    summary="The viscous friction differs from the model's.",
    law="b → b (1 + r)",
    parameters=parameters_of("viscous_friction"),
    source="Eq. 1.",
    where_it_shows="A residual torque proportional to velocity.",
    near=("quadratic_drag", "asymmetric_viscous"),
    exact=True,
)
