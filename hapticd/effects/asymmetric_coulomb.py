"""Coulomb friction that differs between the directions: c± = c(1 ± a)."""

from __future__ import annotations

from hapticd.effects.parameters import relative
from hapticd.effects.spec import Effect, Notes


def torque(coulomb: float, a: float) -> float:
    """Return the constant torque −a c that is equal to the asymmetry."""
    return -a * coulomb


EFFECT = Effect(
    slug="asymmetric_coulomb",
    summary="Coulomb friction differs between the two directions.",
    law="torque −c sgn(ω) − a c",
    parameters=(relative("a", -1.0, 1.0),),
    acts_on="friction",
    source="Armstrong-Hélouvry, Dupont and Canudas de Wit 1994.",
    where_it_shows=(
        "A residual torque of −a c in both directions, at every speed: no data distinguish it from a constant bias."
    ),
    example="a: 0.2",
    notes=Notes(
        told_apart=(
            "`constant_bias` with tau_0 = −a c is the same model: no data separate the two. Which name is "
            "right is found at the device: unload it, or turn it round."
        ),
        shown_by="no motion; both names are reported together.",
        in_theory="The direction with less friction counts.",
        simulated="Closed form.",
    ),
    amplitude="a",
    grid=lambda scale: [{"a": 0.05}],
    equivalent_to=("constant_bias",),
    in_loop=lambda loop, values: {"coulomb": loop.coulomb * (1.0 - abs(values["a"]))},
)
