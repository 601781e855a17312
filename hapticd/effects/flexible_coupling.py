"""Motor and load joined by a spring and a damper."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects.parameters import NUMBER, load_share, log_grid
from hapticd.effects.spec import Effect, Notes, Parameter, Scale, Values


def _grid(scale: Scale) -> Iterable[Values]:
    return [
        {"f_r": f_r, "load_share": 0.35, "damping": 0.05}
        for f_r in log_grid(max(0.5, 0.003 / scale.period_s), 0.15 / scale.period_s, 18)
    ]


EFFECT = Effect(
    slug="flexible_coupling",
    summary="A flexible coupling or belt between the motor, which has encoder and friction, and the load.",
    law=(
        "inertia (1 − load_share) J on the motor, J_L = load_share J behind it; torque k (θ_L − θ) + d (ω_L − ω), k = "
        "J_L (2π f_r)², d = 2 damping J_L 2π f_r"
    ),
    parameters=(
        Parameter("f_r", "Hz", "Hz", neutral=math.inf, lower=0.1, upper=1e4, scale="log", required=True),
        load_share(),
        Parameter("damping", *NUMBER, neutral=0.02, lower=0.0, upper=2.0, scale="log"),
    ),
    acts_on="memory",
    source="Two-mass drive: Ellis and Lorenz 2000; f_r is the anti-resonance seen from the motor.",
    where_it_shows="After each step the shaft rings at f_r / √(1 − load_share); at f_r it hardly moves.",
    example="f_r: 60",
    notes=Notes(
        told_apart="`amplifier_lag` rings only after changes of the current; `backlash` is free within its gap.",
        shown_by="a chirp through f_r and its resonance.",
        simulated=(
            "The load is exact for constant acceleration of the motor, substeps are at most 0.35 rad of the resonance "
            "(2·10⁻³ of the distance in the tests); every step is stable and conserves momentum to rounding."
        ),
    ),
    grid=_grid,
    accuracy=1e-3,
    near=("amplifier_lag", "backlash"),
    contains=("inertia_error",),
    excludes=("backlash",),
)
