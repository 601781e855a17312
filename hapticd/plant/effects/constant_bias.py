"""A constant torque on the shaft: + τ₀."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="constant_bias",
    summary="A constant torque: a cable, an amplifier's offset, a weight far from its rest.",
    law="+ tau_0",
    parameters=parameters_of("constant_bias"),
    source="Janot, Gautier and Brunot 2019 (EMPS) identify it as the offset of the drive.",
    where_it_shows=(
        "The same residual torque at all speeds and positions; the two directions of motion differ by twice it."
    ),
    equivalent_to=("asymmetric_coulomb",),
    near=("gravity", "return_spring", "asymmetric_viscous"),
    exact=True,
)
