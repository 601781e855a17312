"""A spring to a rest position: −k_s(θ − θ₀)."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="return_spring",
    summary="A spring to a rest position: a cable, a flexure, a return spring.",
    law="−k_s (θ − theta_0)",
    parameters=parameters_of("return_spring"),
    source="Hooke's law.",
    where_it_shows="A residual torque linear in position, also at rest.",
    near=("gravity", "hand_impedance", "constant_bias"),
    exact=True,
)
