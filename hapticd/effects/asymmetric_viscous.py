"""Viscous friction that differs between the directions: b± = b(1 ± a)."""

from __future__ import annotations

from hapticd.effects.parameters import relative
from hapticd.effects.spec import Effect, Notes


def viscous(nominal: float, a: float, direction: float) -> float:
    """Return the viscous friction of one direction (±1)."""
    return nominal * (1.0 + a * direction)


EFFECT = Effect(
    slug="asymmetric_viscous",
    summary="Viscous friction differs between the two directions.",
    law="b → b (1 + a sgn(ω))",
    parameters=(relative("a", -1.0, 1.0),),
    acts_on="friction",
    source="Janot, Gautier and Brunot 2019 (EMPS).",
    where_it_shows="A residual torque −a b |ω|: the same sign in both directions, zero at standstill.",
    example="a: 0.3",
    notes=Notes(
        told_apart=(
            "`constant_bias` does not vanish at standstill. With motion at one speed only, or mostly one way, the two are "
            "confounded: report them as a pair."
        ),
        shown_by="equal motion both ways at several speeds, and slow reversals.",
        in_theory="The direction with less friction counts.",
        simulated="Closed form between stops; stops are located.",
    ),
    amplitude="a",
    grid=lambda scale: [{"a": 0.05}],
    accuracy=1e-3,
    near=("constant_bias",),
    in_loop=lambda loop, values: {"viscous": loop.viscous * (1.0 - abs(values["a"]))},
)
