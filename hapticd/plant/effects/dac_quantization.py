"""The command is on a coarse grid: i → q round(i/q)."""

from __future__ import annotations

import numpy as np

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="dac_quantization",
    summary="The command passes a converter coarser than the model's.",
    law="i → q round(i / q), halves to even",
    parameters=parameters_of("dac_quantization"),
    source=(
        "Resolution of a digital-to-analogue converter or of an integer drive object (CiA 402: 0.1 % of rated torque)."
    ),
    where_it_shows="Residual torque as a sawtooth of the command; small commands do nothing.",
    near=("current_saturation", "load_dependent_friction"),
    exact=True,
)


@njit("float64(float64, float64)", inline=True)
def on_grid(current: float, q: float) -> float:
    """Return the current on the grid; q = 0 leaves it as it is."""
    level = current / q if q > 0.0 else np.inf
    # Beyond 2⁵³ a double has no finer grid than its own.
    return q * np.rint(level) if abs(level) < 2.0**53 else current
