"""An effect of one's own: a magnet that holds the shaft in one place, −a u exp((1 − u²)/2) with u = (θ − θ₀)/w."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects import Effect, Notes, Parameter, Scale, Values, magnitude, shift


def force(position: float, velocity: float, time: float, current: float, a: float, theta_0: float, w: float) -> float:
    """Return the torque [N m]; its largest value, a, is w away from the place."""
    u = (position - theta_0) / w
    return -a * u * math.exp(0.5 * (1.0 - u * u))


def _grid(scale: Scale) -> Iterable[Values]:
    a, w = 0.05 * scale.torque, 0.1 * scale.travel
    return [{"a": a, "theta_0": theta_0, "w": w} for theta_0 in scale.positions]


def _stiffness(values: Values) -> float:
    return float(values["a"] / values["w"] * math.exp(0.5))


EFFECT = Effect(
    slug="magnetic_detent",
    summary="A magnet holds the shaft in one place and lets go of it farther away.",
    law="−a u exp((1 − u²)/2), u = (θ − theta_0)/w",
    parameters=(
        magnitude("a", ("N m", "N"), 1e4),
        shift("theta_0"),
        Parameter("w", "rad", "m", neutral=1.0, lower=1e-6, upper=10.0, scale="log", required=True),
    ),
    acts_on="force",
    source="A derivative of a Gaussian potential.",
    where_it_shows="A residual torque over position that changes sign in one place and fades on both sides of it.",
    example="a: 1.0e-3, theta_0: 0.0, w: 0.1",
    notes=Notes(
        told_apart="`return_spring` grows all the way, `torque_ripple` comes again.",
        shown_by="slow motion both ways over the place and well beyond it.",
    ),
    amplitude="a",
    grid=_grid,
    near=("return_spring", "torque_ripple"),
    stiffness=_stiffness,
    force=force,
)
