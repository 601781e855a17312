"""Coulomb friction that differs between the directions: c± = c(1 ± a)."""

from __future__ import annotations

from hapticd.effects.parameters import relative
from hapticd.effects.spec import Effect, Notes


def torque(coulomb: float, a: float) -> float:
    """Return the constant torque −a c that the asymmetry amounts to."""
    return -a * coulomb


EFFECT = Effect(
    slug="asymmetric_coulomb",
    summary="Coulomb friction differs between the two directions.",
    law="torque −c sgn(ω) − a c",
    parameters=(relative("a", -1.0, 1.0),),
    acts_on="friction",
    source="Armstrong-Hélouvry, Dupont and Canudas de Wit 1994.",
    where_it_shows=(
        "A residual torque that is the same in both directions; no data can tell it from a constant bias of −a c."
    ),
    example="a: 0.2",
    notes=Notes(
        in_data=("The two directions differ by 2 a c at every speed, exactly as under a constant torque of −a c."),
        told_apart=(
            "With `constant_bias` of tau_0 = −a c it is one and the same model: no data separate the two. Which name is "
            "right is decided at the device: unload it, or turn it round."
        ),
        shown_by="nothing on the data's side; the class is reported as one.",
        in_theory="The weaker side counts.",
        simulated="Closed form.",
    ),
    amplitude="a",
    grid=lambda scale: [{"a": 0.05}],
    equivalent_to=("constant_bias",),
    in_loop=lambda loop, values: {"coulomb": loop.coulomb * (1.0 - abs(values["a"]))},
)
