"""The command is quantised with a coarse step: i → q round(i/q)."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects.parameters import log_grid, magnitude
from hapticd.effects.spec import Effect, Notes, Scale, Values


def on_grid(current: float, q: float) -> float:
    """Return the current rounded to the step; q = 0 does not change it."""
    level = current / q if q > 0.0 else math.inf
    # Above 2⁵³ every double is a whole number.
    return q * math.copysign(float(round(abs(level))), level) if abs(level) < 2.0**53 else current


def _grid(scale: Scale) -> Iterable[Values]:
    largest = scale.currents[-1]
    return [{"q": q} for q in log_grid(3e-3 * largest, 0.8 * largest, 400)]


EFFECT = Effect(
    slug="dac_quantization",
    summary="The command passes a converter with a larger step than the model's.",
    law="i → q round(i / q), halves to even",
    parameters=(magnitude("q", ("A", "A"), 1e4),),
    acts_on="input",
    source=(
        "Resolution of a digital-to-analogue converter or of an integer drive object (CiA 402: 0.1 % of rated torque)."
    ),
    where_it_shows=(
        "The residual torque over the commanded current is a sawtooth of amplitude K_t q / 2; commands below q / 2 have "
        "no effect."
    ),
    example="q: 0.02",
    notes=Notes(
        told_apart=("Friction hides smaller steps; `current_saturation` acts at large currents only."),
        shown_by="slow ramps of small currents, many levels of q.",
        simulated="Closed form.",
    ),
    grid=_grid,
    near=("current_saturation", "load_dependent_friction"),
)
