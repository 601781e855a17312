"""A constant torque on the shaft: + τ₀."""

from __future__ import annotations

from hapticd.effects.parameters import TORQUE
from hapticd.effects.spec import Effect, Notes, Parameter

EFFECT = Effect(
    slug="constant_bias",
    summary="A constant torque: a cable, an amplifier's offset, a weight far from its rest.",
    law="+ tau_0",
    parameters=(Parameter("tau_0", *TORQUE, neutral=0.0, lower=-1e4, upper=1e4, required=True),),
    acts_on="force",
    source="Janot, Gautier and Brunot 2019 (EMPS) identify it as the offset of the drive.",
    where_it_shows=(
        "The same residual torque at all speeds and positions: the two directions differ by twice tau_0, also in the "
        "current at which the shaft breaks away."
    ),
    example="tau_0: 5.0e-4",
    notes=Notes(
        told_apart=(
            "`asymmetric_coulomb` is the same model with another name (a = −tau_0 / c). `gravity` and `return_spring` "
            "change with position, which small motion hides; `asymmetric_viscous` vanishes at standstill."
        ),
        shown_by="motion both ways over the whole range of positions, slow reversals included.",
        in_theory="It moves the position of rest and does not change the criterion.",
        simulated="Closed form.",
    ),
    amplitude="tau_0",
    grid=lambda scale: [{"tau_0": 0.05 * scale.torque}],
    equivalent_to=("asymmetric_coulomb",),
    near=("gravity", "return_spring", "asymmetric_viscous"),
    in_loop=lambda loop, values: {},
)
