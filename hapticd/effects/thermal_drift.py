"""Friction changes as the device warms up: c → c(1 + r(1 − exp(−t/t_w)))."""

from __future__ import annotations

import math

from hapticd.effects.parameters import relative
from hapticd.effects.spec import Effect, Notes, Parameter


def factor(time: float, r: float, t_w: float) -> float:
    """Return the factor on the Coulomb friction at a time since the start."""
    return 1.0 - r * math.expm1(-time / t_w)


EFFECT = Effect(
    slug="thermal_drift",
    summary="Friction changes as the device warms up, from the start of the record on.",
    law="c → c (1 + r (1 − exp(−t / t_w))), t the plant's time",
    parameters=(
        relative("r", -1.0, 10.0),
        Parameter("t_w", "s", "s", neutral=1.0, lower=1e-3, upper=1e6, scale="log", required=True),
    ),
    acts_on="friction",
    source="First-order warming; friction over temperature: Bittencourt and Gunnarsson 2012.",
    where_it_shows="A Coulomb residual that grows over the record and levels off.",
    example="r: 0.4, t_w: 60",
    notes=Notes(
        told_apart=(
            "`coulomb_friction` acts from the first second; in a record short against t_w only r / t_w is known."
        ),
        shown_by="the same motion repeated for several t_w, from cold.",
        in_theory="Cold or warm, whichever has less friction.",
        simulated="The factor is that of the middle of each substep.",
    ),
    amplitude="r",
    grid=lambda scale: [{"r": 0.1, "t_w": share * scale.duration_s} for share in (0.03, 0.1, 0.3, 1.0)],
    accuracy=1e-3,
    near=("coulomb_friction",),
    contains=("coulomb_friction",),
    in_loop=lambda loop, values: {"coulomb": loop.coulomb * min(1.0, 1.0 + values["r"])},
)
