"""The Coulomb friction is not the model's: c → c(1 + r)."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="coulomb_friction",
    summary="The Coulomb friction, and with it stiction, differs from the model's.",
    law="c → c (1 + r)",
    parameters=parameters_of("coulomb_friction"),
    source="Eq. 1.",
    where_it_shows=(
        "A residual torque that changes sign with the direction of motion and not with the speed; the shaft "
        "sticks at other loads."
    ),
    near=("stribeck", "load_dependent_friction"),
    exact=True,
)
