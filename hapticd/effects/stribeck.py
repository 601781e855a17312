"""Friction that decreases with speed near rest, or rises (s < 0): c → c(1 + s exp(−(ω/ω_s)²))."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects.parameters import SPEED, log_grid, relative
from hapticd.effects.spec import Effect, Notes, Parameter, Scale, Values


def factor(speed: float, s: float, omega_s: float) -> float:
    """Return the factor on the Coulomb friction."""
    ratio = speed / omega_s
    return 1.0 + s * math.exp(-ratio * ratio)


def _grid(scale: Scale) -> Iterable[Values]:
    high = scale.speeds[3]
    low = min(max(0.1 * scale.speeds[0], 1e-3 * high, scale.slowest), high)
    return [{"s": 0.1, "omega_s": omega_s} for omega_s in log_grid(low, high, 6)]


EFFECT = Effect(
    slug="stribeck",
    summary="Friction near standstill is larger than in motion (s > 0), or smaller: it rises from rest (s < 0).",
    law="c → c (1 + s exp(−(ω/omega_s)²))",
    parameters=(
        relative("s", -0.99, 10.0),
        Parameter("omega_s", *SPEED, neutral=1.0, lower=1e-6, upper=1e4, scale="log", required=True),
    ),
    acts_on="friction",
    source="Armstrong-Hélouvry, Dupont and Canudas de Wit 1994 (Gaussian form).",
    where_it_shows=(
        "Residuals at speeds below about two omega_s. With s > 0 there is too much friction before stops, breakaway at c "
        "(1 + s), then a jump; with a spring, stick-slip. With s < 0 there is too little, and the shaft creeps away: "
        "grease or seals that build up friction, or a smooth Coulomb friction such as c tanh(ω/ω_s)."
    ),
    example="s: 0.4, omega_s: 3.0",
    notes=Notes(
        told_apart=(
            "`quadratic_drag` with d < 0 also bends the friction curve down, but at high speed; `presliding` delays "
            "friction over a distance rather than over a speed; `coulomb_friction` does not depend on speed."
        ),
        shown_by="slow ramps and slow sweeps that pass 0.3 to 3 omega_s several times both ways.",
        in_theory="The smallest friction counts: c, or c (1 + s) if s < 0.",
        simulated=(
            "Second order in the substep; stops and breakaway are located (2·10⁻³ of the distance or better in the tests)."
        ),
    ),
    amplitude="s",
    grid=_grid,
    accuracy=1e-3,
    near=("quadratic_drag", "presliding", "coulomb_friction"),
    contains=("coulomb_friction",),
    in_loop=lambda loop, values: {"coulomb": loop.coulomb * min(1.0, 1.0 + values["s"])},
)
