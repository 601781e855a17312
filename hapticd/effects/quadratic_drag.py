"""Drag that grows with the square of the speed: −d ω|ω|."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects.spec import Effect, Notes, Parameter, Scale, Values


def relief(speed: float, d: float, friction: float) -> float:
    """Return by how much d < 0 lowers the other friction: |d| speed², at most all of it."""
    return min(-d * speed * speed, friction)


def _grid(scale: Scale) -> Iterable[Values]:
    fastest = scale.speeds[-1]
    d = 0.05 * scale.torque / fastest**2 if fastest > 0.0 else math.inf
    return [{"d": d}]


EFFECT = Effect(
    slug="quadratic_drag",
    summary="Drag quadratic in speed; with d < 0 friction that grows less than linearly.",
    law="−d ω|ω|, for d < 0 at most the other friction: the sum never drives the shaft",
    parameters=(Parameter("d", "N m s²/rad²", "N s²/m²", neutral=0.0, lower=-1e4, upper=1e4, required=True),),
    acts_on="friction",
    source="Windage and lubricant churning; friction of greased gears is often degressive.",
    where_it_shows="The residual torque over velocity is a parabola, odd in velocity.",
    example="d: 2.0e-7",
    notes=Notes(
        told_apart="`viscous_friction` is a straight line; `stribeck` bends at low speed only.",
        shown_by="steady motion over a wide range of speeds, the largest at least three times the smallest.",
        simulated=(
            "Second order in the substep; stops and breakaway are located (2·10⁻³ of the distance or better in the tests)."
        ),
    ),
    amplitude="d",
    grid=_grid,
    accuracy=1e-3,
    near=("stribeck", "viscous_friction"),
)
