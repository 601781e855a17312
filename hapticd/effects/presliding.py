"""The LuGre bristle: friction is elastic before it slides."""

from __future__ import annotations

import math
from collections.abc import Iterable

from hapticd.effects.parameters import ANGLE, DAMPING, magnitude, small_displacements
from hapticd.effects.spec import Effect, Notes, Scale, Values


def bristle_after(z: float, steady: float, distance: float) -> float:
    """Return the deflection after a distance in one direction: over distance the law is linear, at any speed.

    Args:
        z: deflection before [rad or m].
        steady: deflection in steady sliding, with the sign of the direction.
        distance: distance covered, ≥ 0.
    """
    return steady + (z - steady) * math.exp(-distance / abs(steady))


def _grid(scale: Scale) -> Iterable[Values]:
    starts = []
    for breakaway in small_displacements(scale, 3.0):
        # Damping ratio ½ of the shaft on the bristle.
        half_damped = math.sqrt(scale.coulomb / breakaway * scale.inertia)
        starts += [{"breakaway": breakaway, "sigma_1": sigma_1} for sigma_1 in (half_damped, 0.05 * half_damped)]
    return starts


EFFECT = Effect(
    slug="presliding",
    summary=("Friction is elastic before it slides: the shaft creeps and springs back (LuGre); it replaces stiction."),
    law=(
        "ż = ω − |ω| z sigma_0 / c, torque −(sigma_0 z + sigma_1 ż), sigma_0 = c / breakaway, c with its Stribeck and "
        "load terms in ż"
    ),
    parameters=(magnitude("breakaway", ANGLE, 10.0), magnitude("sigma_1", DAMPING, 1e4, required=False)),
    acts_on="memory",
    source="Canudas de Wit, Olsson, Åström and Lischinsky 1995.",
    where_it_shows=(
        "Small reversing currents below the Coulomb friction move the shaft, and it springs back; after a reversal "
        "friction over position is a curve, not a jump."
    ),
    example="breakaway: 2.0e-3",
    notes=Notes(
        told_apart=(
            "`backlash` frees the shaft after a reversal, but without restoring force, and ends in a jump of the "
            "velocity. `stribeck` depends on speed. In short reversals the three are similar."
        ),
        shown_by=(
            "slow current ramps below breakaway, both ways, with an encoder finer than the breakaway displacement."
        ),
        simulated=(
            "The bristle over the distance is exact; the motion is second order over phases of at most a quarter of the "
            "breakaway displacement while the bristle is far from steady sliding (3·10⁻³ of the distance or better in the "
            "tests). As the breakaway displacement goes to 0 it becomes Coulomb friction."
        ),
    ),
    grid=_grid,
    accuracy=1e-3,
    near=("backlash", "stribeck"),
)
