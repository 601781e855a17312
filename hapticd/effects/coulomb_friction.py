"""The Coulomb friction differs from the model's: c → c(1 + r)."""

from __future__ import annotations

from hapticd.effects.parameters import corrected, relative
from hapticd.effects.spec import Effect, Notes

EFFECT = Effect(
    slug="coulomb_friction",
    summary="The Coulomb friction, and with it stiction, differs from the model's.",
    law="c → c (1 + r)",
    parameters=(relative("r", -1.0, 5.0),),
    acts_on="base",
    source="Eq. 1.",
    where_it_shows=(
        "A residual torque of constant magnitude with the sign of the motion; the shaft breaks away at another current."
    ),
    example="r: 0.5",
    notes=Notes(
        told_apart=(
            "`stribeck` adds friction only near standstill, `load_dependent_friction` only under current, `thermal_drift` "
            "only later in the record."
        ),
        shown_by="slow ramps, and motion both ways at several speeds and loads.",
        simulated="Closed form.",
    ),
    amplitude="r",
    reach=lambda scale: scale.torque / scale.coulomb,
    grid=lambda scale: [{"r": 0.05}],
    near=("stribeck", "load_dependent_friction"),
    in_loop=lambda loop, values: {"coulomb": corrected(loop.coulomb, values["r"])},
)
