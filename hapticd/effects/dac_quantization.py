"""The command is on a coarse grid: i → q round(i/q)."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects.parameters import log_grid, magnitude
from hapticd.effects.spec import Effect, Notes, Scale, Values


def on_grid(current: float, q: float) -> float:
    """Return the current on the grid; q = 0 leaves it as it is."""
    level = current / q if q > 0.0 else math.inf
    # Beyond 2⁵³ a double has no finer grid than its own.
    return q * math.copysign(float(round(abs(level))), level) if abs(level) < 2.0**53 else current


def _grid(scale: Scale) -> Iterable[Values]:
    largest = scale.currents[-1]
    return [{"q": q} for q in log_grid(3e-3 * largest, 0.8 * largest, 400)]


EFFECT = Effect(
    slug="dac_quantization",
    summary="The command passes a converter coarser than the model's.",
    law="i → q round(i / q), halves to even",
    parameters=(magnitude("q", ("A", "A"), 1e4),),
    acts_on="input",
    source=(
        "Resolution of a digital-to-analogue converter or of an integer drive object (CiA 402: 0.1 % of rated torque)."
    ),
    where_it_shows="Residual torque as a sawtooth of the command; small commands do nothing.",
    example="q: 0.02",
    notes=Notes(
        in_data=(
            "The residual torque over the commanded current is a sawtooth of amplitude K_t q / 2; commands below q / 2 do "
            "nothing."
        ),
        told_apart=("Friction hides steps that are smaller than it; `current_saturation` acts at large currents only."),
        shown_by="slow ramps of small currents, many levels of q.",
        simulated="Closed form.",
    ),
    grid=_grid,
    near=("current_saturation", "load_dependent_friction"),
)
