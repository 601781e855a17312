"""The inertia is not the model's: J → J(1 + r)."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="inertia_error",
    summary="The device's inertia differs from the model's.",
    law="J → J (1 + r)",
    parameters=parameters_of("inertia_error"),
    source="Eq. 1; inertias on data sheets leave out shaft, coupling and handle.",
    where_it_shows=(
        "Acceleration after every change of force is too large or too small by the same factor, in both directions."
    ),
    near=("torque_constant_error",),
    exact=True,
)
