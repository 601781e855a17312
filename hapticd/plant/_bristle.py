"""One phase of the shaft on the LuGre bristle (`presliding`): to the next stop, or the largest accurate step."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.effects import presliding
from hapticd.jit import effect_term, njit
from hapticd.plant._slide import FORCES, Forces, friction_of, glide_on_spring, pull_on
from hapticd.plant.effect_terms import coulomb_level, damping_at
from hapticd.plant.exact import phi_functions
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_p = types.Array(_f8, 1, "C")
_BREAKAWAY = index_of("presliding.breakaway")
_SIGMA_1 = index_of("presliding.sigma_1")
_bristle_after = effect_term(presliding.bristle_after)

# A bristle phase covers a quarter of the breakaway displacement, more if the bristle is near steady sliding.
_BRISTLE_DISTANCE = 0.25
_SMALLEST = 1e-300


@njit(types.UniTuple(_f8, 4)(_p, _f8, _f8, _f8, _f8, FORCES), counted=False)
def slide_on_bristle(
    p: NDArray[Any], x: float, v: float, z: float, span: float, on: Forces
) -> tuple[float, float, float, float]:
    """Move the shaft through one phase of LuGre friction; arguments as in `hapticd.plant._slide.slide`.

    Over distance the bristle's law is linear and solved exactly. In the equation of motion the bristle is a spring of the
    chord's stiffness over the distance of the phase, which is short while the bristle is far from steady sliding; an
    oscillation in the elastic range is one phase from turning point to turning point, for any stiffness. The deflection `z`
    of the bristle is in rad or m.

    Returns:
        Position, velocity, bristle deflection and duration.
    """
    sigma_0 = coulomb_level(p) / p[_BREAKAWAY]
    pull = pull_on(p, x, x, v, on) - sigma_0 * z
    if v == 0.0 and pull == 0.0:
        return x, 0.0, z, span
    sign = math.copysign(1.0, v if v != 0.0 else pull)
    speed = abs(v)
    strain = sign * z
    limit = span
    distance, end, time = 0.0, speed, span
    steady = p[_BREAKAWAY]
    for attempt in range(2):
        mean_speed = 0.5 * (speed + end)
        level, total = damping_at(p, mean_speed, sign, friction_of(p, mean_speed, on), on.viscous)
        steady = max(level / sigma_0, 1e-6 * p[_BREAKAWAY])
        slack = 1.0 - strain / steady
        if attempt == 0:
            reach = _BRISTLE_DISTANCE * steady / math.sqrt(abs(slack) + _SMALLEST)
            push = abs(pull) / on.inertia
            limit = min(span, 2.0 * reach / (speed + math.sqrt(speed * speed + 2.0 * push * reach) + _SMALLEST))
        # Mean over the distance of the fraction 1 − z/steady that stretches the bristle; its chord's stiffness likewise.
        _, mean, of_mean = phi_functions(-distance / steady)
        stretch = slack * mean
        pull = sign * (pull_on(p, x, x + sign * distance, sign * mean_speed, on) - sigma_0 * z)
        spring = sigma_0 * stretch
        if spring < 0.0:
            # Beyond steady sliding the bristle relaxes: no spring, but a force that decreases over the distance.
            pull -= sigma_0 * distance * slack * of_mean
            spring = 0.0
        total += on.damping + p[_SIGMA_1] * max(stretch, 0.0)
        distance, end, time = glide_on_spring(
            speed, pull / on.inertia, limit, total / on.inertia, (spring + on.stiffness) / on.inertia
        )
    if time == 0.0 and v == 0.0:
        return x, 0.0, z, span
    return x + sign * distance, sign * end if end > 0.0 else 0.0, sign * _bristle_after(strain, steady, distance), time
