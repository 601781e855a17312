"""The amplifier's current is limited: clip(i, ±i_max)."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects.parameters import log_grid
from hapticd.effects.spec import Effect, Notes, Parameter, Scale, Values


def saturate(current: float, i_max: float) -> float:
    """Return the limited current."""
    return min(max(current, -i_max), i_max)


def _grid(scale: Scale) -> Iterable[Values]:
    largest = scale.currents[-1]
    return [{"i_max": current} for current in log_grid(max(scale.currents[0], 0.02 * largest), 0.995 * largest, 80)]


EFFECT = Effect(
    slug="current_saturation",
    summary="The amplifier gives no more than i_max.",
    law="i → clip(i, ±i_max)",
    parameters=(Parameter("i_max", "A", "A", neutral=math.inf, lower=1e-9, upper=1e6, scale="log", required=True),),
    acts_on="input",
    source="Current limit of the drive.",
    where_it_shows="Residuals only where the command exceeds i_max: K_t times the excess.",
    example="i_max: 1.5",
    notes=Notes(
        told_apart="`torque_constant_error` and `load_dependent_friction` show at small currents too.",
        shown_by="commands well above i_max for long enough to see the speed.",
        simulated="Closed form.",
    ),
    grid=_grid,
    near=("torque_constant_error", "load_dependent_friction"),
)
