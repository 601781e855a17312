"""A spring to a rest position: −k_s(θ − θ₀)."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects.parameters import STIFFNESS, magnitude, shift
from hapticd.effects.spec import Effect, Notes, Scale, Values


def _grid(scale: Scale) -> Iterable[Values]:
    k_s = 0.05 * scale.torque / scale.travel if scale.travel > 0.0 else math.inf
    return [{"k_s": k_s, "theta_0": theta_0} for theta_0 in scale.positions]


EFFECT = Effect(
    slug="return_spring",
    summary="A spring to a rest position: a cable, a flexure, a return spring.",
    law="−k_s (θ − theta_0)",
    parameters=(magnitude("k_s", STIFFNESS, 1e6), shift("theta_0")),
    acts_on="force",
    source="Hooke's law.",
    where_it_shows="A residual torque linear in position, at every speed and at rest.",
    example="k_s: 0.01",
    notes=Notes(
        told_apart=(
            "`gravity` near its rest position is the same line until the sine bends; `hand_impedance` acts for part "
            "of the record only; in small motion away from theta_0 it is a `constant_bias`."
        ),
        shown_by="slow motion over the whole range of positions.",
        simulated="Closed form.",
    ),
    amplitude="k_s",
    grid=_grid,
    near=("gravity", "hand_impedance", "constant_bias"),
    contains=("constant_bias",),
    in_loop=lambda loop, values: {"hand_stiffness": loop.hand_stiffness + values["k_s"]},
)
